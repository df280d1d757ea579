#!/usr/bin/env bash
# Prints a systemd unit that starts the suite of one machine with the computer; see --help for its installation.
set -euo pipefail

if [ $# -eq 0 ] || [[ "$1" == -* ]]; then
    cat <<'HELP'
usage: launch_scripts/service.sh NAME [MACHINE [OPTIONS AND ROS ARGUMENTS ...]]

Prints the unit of a service that runs suite.sh for MACHINE (tufting when not given) in the namespace /NAME. Below
/var/lib/textile-twin/NAME, recordings are in out/recordings, the newest 50 GB of them; alarms and what was learnt of the
machine are in out/faults. To put it in place and start it:
  sudo useradd --system textile-twin
  launch_scripts/service.sh loom_3 examples/six_bar_loom.yaml | sudo tee /etc/systemd/system/textile-twin-loom_3.service
  sudo systemctl daemon-reload && sudo systemctl enable --now textile-twin-loom_3
  journalctl -fu textile-twin-loom_3         what it says; journald bounds how much is kept
HELP
    exit
fi
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"

name="$1"
[[ "$name" =~ ^[A-Za-z][A-Za-z0-9_]*$ ]] || fail "NAME must be a ROS namespace such as loom_3, not '$name'"
machine="${2:-tufting}"
if [ -e "$machine" ]; then machine="$(realpath "$machine")"; fi
# The same check as at the start, so that a mistake is reported now and not in a log.
"$venv/bin/python" "$root/launch_scripts/suite.py" --check "$machine" "${@:3}" -r "__ns:=/$name"

quoted=""
for word in "$machine" "${@:3}"; do quoted+=" \"${word//%/%%}\""; done
cat <<UNIT
[Unit]
Description=Digital twin of the textile machine $name
After=network.target time-sync.target
Wants=time-sync.target
StartLimitIntervalSec=0

[Service]
Type=exec
User=textile-twin
StateDirectory=textile-twin/$name
WorkingDirectory=%S/textile-twin/$name
Environment="AMENT_PREFIX_PATH=$venv" "HOME=%S/textile-twin/$name" "ROS_LOG_DIR=%S/textile-twin/$name/log"
# ROS_DOMAIN_ID, ROS_AUTOMATIC_DISCOVERY_RANGE and the like
EnvironmentFile=-/etc/textile-twin/$name.env
ExecStart="$venv/bin/python" "$root/launch_scripts/suite.py"$quoted -r "__ns:=/$name" \\
    -p record_node:keep_GB:=50 --disable-external-lib-logs
KillMode=mixed
KillSignal=SIGINT
SuccessExitStatus=130
TimeoutStopSec=40
Restart=always
RestartSec=5
NoNewPrivileges=yes
PrivateTmp=yes
ProtectSystem=strict
ProtectHome=read-only
ProtectKernelTunables=yes
ProtectControlGroups=yes
RestrictSUIDSGID=yes

[Install]
WantedBy=multi-user.target
UNIT
