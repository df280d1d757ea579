#!/usr/bin/env bash
# Plays a recording of a tufting machine through the nodes, records what they publish, and compares it with the measured torque.
set -euo pipefail

if [[ "${1:-}" == -* ]]; then
    echo "usage: launch_scripts/demo.sh [RATE]"
    echo "RATE: speed of playing, 1 is that of the machine, 2 when not given. The results go to out/demo."
    exit
fi
rate="${1:-2}"
source "$(dirname "${BASH_SOURCE[0]}")/common.sh"
cd "$root"
[[ "$rate" =~ ^[0-9]+(\.[0-9]+)?$ ]] || fail "the rate must be a number such as 2 or 0.5, not '$rate'"

played=bags/tufting_160rpm_synthetic # also in demo.yaml
rm -rf out/demo
mkdir -p out/demo
# Isolate the nodes: this computer only, and a ROS domain above 101, the largest one in common use.
export ROS_DOMAIN_ID="$((215 + $$ % 16))" ROS_LOG_DIR="$root/out/demo/log/ros"

echo "Playing $played at $rate times its speed through replay_node, twin_node and record_node ..."
echo "(the twin's loops are compiled first, about a minute once on a computer; log: out/demo/log)"
programs=()
for node in record_node twin_node replay_node; do
    programs+=(--- "$venv/bin/$node" --ros-args --params-file launch_scripts/demo.yaml)
done
"$venv/bin/python" launch_scripts/bring_up.py --alone --logs out/demo/log --until record_node -- "${programs[@]}" -p "rate:=$rate"

# The check and the comparison read the same recording in parallel.
"$venv/bin/textile-twin" compare out/demo/bag --machine tufting --predicted recorded --json out/demo/comparison.json \
    --rrd out/demo/comparison.rrd --png out/demo/comparison.png > out/demo/comparison.txt &
comparing=$!
trap 'kill "$comparing" 2> /dev/null || true' EXIT
"$venv/bin/python" launch_scripts/demo_check.py "$played" out/demo/bag
wait "$comparing"
echo
cat out/demo/comparison.txt

cat <<'FURTHER'

Look further:
  out/demo/comparison.png                                torque and residual, over time and over the shaft angle
  .venv/bin/textile-twin view out/demo/comparison.rrd    the machine in motion beside its torque
  .venv/bin/textile-twin compare --help                  what else can be compared: out/demo/bag is the recording
FURTHER
