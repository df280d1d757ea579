"""C sources of a machine with an elastic main shaft: tables of its chain, parameters of the shaft, outputs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from textile_twin_core.driveline import ElasticShaft, elastic_shaft
from textile_twin_core.expression import Expr
from textile_twin_core.expression.c_source import PLAIN_SINCOS, c_function
from textile_twin_core.fmu.model_code import ModelCode, finished, static_array
from textile_twin_core.machine import Machine, ShaftPlace
from textile_twin_core.machine.elastic_outputs import (
    ACCELERATION,
    ANGLE,
    LAG,
    PARTS,
    PIECE_TORQUE,
    PLACED,
    POSITION,
    SPEED,
    SPREAD,
    SUMS,
    ElasticOutput,
    elastic_outputs,
)

_BALANCING, _INERTIAL = "balancing_torque_Nm", "torque_inertial_Nm"
_SHAFT = "const double *theta, const double *omega, const double *alpha, const double *piece"
_ONE = "double theta, double omega, double alpha, double *z"


@dataclass(frozen=True)
class ChainCode:
    """Sources of an elastic shaft, its parameters, its stations, and the number of the one with a given motion."""

    code: ModelCode
    parameters: Mapping[str, float]
    stations: tuple[str, ...]
    driven: int


def chain_code(machine: Machine, outputs: Sequence[str], torque_input: bool, about: object) -> ChainCode:
    """Write the C sources of a machine with an elastic main shaft.

    Parameters are the numbers of the shaft; the linkages are tables, as in `elastic_shaft`.

    Args:
        machine: the machine.
        outputs: names of its outputs.
        torque_input: whether the drive torque is the input, instead of the motion of the encoder's station. The slip
            of the machine file then does not count, as in `drive`.
        about: further text that distinguishes the model description.

    Raises:
        MachineError: as `elastic_shaft`.
    """
    shaft = machine.shaft
    assert shaft is not None
    if torque_input:
        shaft = replace(shaft, drive=replace(shaft.drive, slip_Nms_rad=None))
    elastic = elastic_shaft(replace(machine, shaft=shaft))
    parameters, setting = _parameters(elastic, torque_input)
    chain, shown = elastic.chain, _Outputs(machine, elastic)
    lines = [f"y[{k}] = {shown.text(name)};" for k, name in enumerate(outputs)]
    drawn = shown.functions()
    evaluated = "".join(f"    {line}\n" for line in [*shown.calls(), *lines])
    tables = {
        "int tt_first": chain.first, "double tt_phase": chain.phase, "int tt_profile": chain.profile,
        "int tt_node_begin": chain.node_begin, "int tt_powers": chain.powers,
        "int tt_start_begin": chain.start_begin, "double tt_starts": chain.starts,
        "double tt_coefficients": chain.coefficients, "double tt_ratio": elastic.ratios, "double tt_table": chain.table,
    }  # fmt: skip
    source = "\n".join(
        [
            '#include <math.h>\n#include "textile_twin.h"\n',
            PLAIN_SINCOS,
            *(static_array(name, values) for name, values in tables.items()),
            "TT_LOCAL void tt_start_values(double *p) {\n"
            + "".join(f"    p[{k}] = {value!r};\n" for k, value in enumerate(parameters.values()))
            + "}\n",
            "TT_LOCAL void tt_shaft(const double *p, tt_state *s) {\n"
            + "".join(f"    s->{line}\n" for line in setting)
            + "}\n",
            *drawn,
            f"TT_LOCAL void tt_outputs({_SHAFT}, double *y) {{\n"
            f"    (void)theta; (void)omega; (void)alpha; (void)piece;\n{evaluated}}}\n",
        ]
    )
    sizes = {
        "CHAIN": 1,
        "TORQUE_INPUT": int(torque_input),
        "OUTPUTS": len(outputs),
        "PARAMETERS": len(parameters),
        "STATIONS": elastic.stations,
        "HANGERS": chain.phase.size,
        "LOADS": chain.coefficients.shape[1],
        "PLAY": int(bool((chain.half_play > 0.0).any())),
        "DRIVE": shaft.drive_station,
        "FIXED": -1 if torque_input else shaft.encoder_station,
    }
    code = finished(source, sizes, [outputs, list(parameters), about], 0, ())
    return ChainCode(code, parameters, shaft.names, shaft.encoder_station)


def indicators(machine: Machine) -> int:
    """Number of event indicators of a chain: TT_INDICATORS in c/textile_twin.h."""
    chain = elastic_shaft(machine).chain
    pieces = 2 * chain.half_play.size if (chain.half_play > 0.0).any() else 0
    return int(chain.inertia.size + 2 * chain.phase.size + pieces)


def _parameters(elastic: ElasticShaft, torque_input: bool) -> tuple[dict[str, float], list[str]]:
    """Parameters of the shaft, and the C assignments of the chain's numbers from them."""
    shaft, chain, ratios = elastic.shaft, elastic.chain, elastic.ratios
    found: dict[str, float] = {}

    def p(name: str, value: float) -> str:
        found[name] = float(value)
        return f"p[{len(found) - 1}]"

    drive, lines = shaft.drive_station, list[str]()
    for i, station in enumerate(shaft.stations):
        square = float(ratios[i]) ** 2
        own, slow = station.inertia_kgm2, station.viscous_Nms
        inertia = p(f"shaft.stations.{station.name}.inertia_kgm2", own)
        viscous = p(f"shaft.stations.{station.name}.viscous_Nms", slow)
        if i == drive:
            own += shaft.drive.inertia_kgm2 or 0.0
            inertia += f" + {p('shaft.drive.inertia_kgm2', shaft.drive.inertia_kgm2 or 0.0)}"
            if not torque_input:
                viscous += f" + {p('shaft.drive.slip_Nms_rad', shaft.drive.slip_Nms_rad or 0.0)}"
        rest = float(chain.inertia[i]) - own * square  # of the bars beside the station
        lines += [
            f"inertia[{i}] = {max(rest, 0.0)!r} + {square!r} * ({inertia});",
            f"viscous[{i}] = {square!r} * ({viscous});",
        ]
    for i, piece in enumerate(shaft.pieces):
        far = float(ratios[i + 1])
        place = f"shaft.pieces.{piece.from_station}_{piece.to_station}"
        lines += [
            f"stiffness[{i}] = {far * far!r} * {p(f'{place}.stiffness_Nm_rad', piece.stiffness)};",
            f"damping[{i}] = {far * far!r} * {p(f'{place}.damping_Nms_rad', piece.damping_Nms_rad)};",
        ]
        play = repr(piece.backlash_rad)
        if piece.backlash_rad > 0.0:
            play = p(f"{place}.backlash_rad", piece.backlash_rad)
        lines.append(f"half_play[{i}] = {0.5 / abs(far)!r} * {play};")
    return found, lines


@dataclass
class _Outputs:
    """C expressions of the outputs, and the functions of single linkages that they need."""

    machine: Machine
    elastic: ElasticShaft
    usual: list[Expr] = field(default_factory=list)
    each: list[Expr] = field(default_factory=list)
    """Quantities of a linkage at its own crank angle."""
    rows: dict[str, int] = field(default_factory=dict)
    """Number of the row of `each` by linkage, or `at encoder` by linkage."""

    def __post_init__(self) -> None:
        lone = replace(self.machine, shaft=None, linkages=(ShaftPlace(),))
        self._lone = lone
        self._first = replace(lone, linkages=(ShaftPlace(self.machine.linkages[0].phase_rad),))
        self._two = replace(lone, linkages=(ShaftPlace(), ShaftPlace()))
        self._elastic = elastic_outputs(self.machine)
        self._stations = [self.elastic.shaft.station(place.at, "at") for place in self.machine.linkages]

    def text(self, name: str) -> str:
        """C expression of an output."""
        shaft = self.elastic.shaft
        piece, sign = shaft.torque_piece
        if name == _BALANCING:
            return f"{float(sign)!r} * piece[{piece}]"
        if name == _INERTIAL:
            return " - ".join([self.text(_BALANCING), *(f"({self.text(part)})" for part in PARTS)])
        if name in SUMS:
            alone, both = self._lone.model.output(name), self._two.model.output(name)
            more = range(1, len(self._stations))
            return " + ".join([self._of(0, alone), *(self._of(k, both - alone) for k in more)])
        if name in self._elastic:
            return self._of_the_shaft(self._elastic[name])
        self.usual.append(self._first.model.output(name))
        return f"u[{len(self.usual) - 1}]"

    def _of_the_shaft(self, output: ElasticOutput) -> str:
        k, ratio, linkages = output.number, self.elastic.ratios, range(len(self._stations))
        encoder = self.elastic.shaft.encoder_station
        if output.kind == PIECE_TORQUE:
            return f"piece[{k}]"
        if output.kind in (ANGLE, SPEED, ACCELERATION):
            of = {ANGLE: "theta", SPEED: "omega", ACCELERATION: "alpha"}[output.kind]
            return f"{float(ratio[k])!r} * {of}[{k}]"
        if output.kind == LAG:
            return f"theta[{encoder}] - theta[{max(self._stations)}]"
        if output.kind == PLACED:
            return self._of(k, self._lone.model.output(output.of_linkage))
        if output.kind == POSITION:
            return self._of(k, self._lone.model.output(f"{output.measure}_position_m"))
        if output.kind == SPREAD:
            measure = self._lone.model.output(f"{output.measure}_position_m")
            off = [f"{self._of(n, measure)} - {self._of(n, measure, encoder)}" for n in linkages]
            largest, smallest = off[0], off[0]
            for each in off[1:]:
                largest, smallest = f"fmax({largest}, {each})", f"fmin({smallest}, {each})"
            return f"{largest} - {smallest}"
        return f"theta[0] - theta[{self.elastic.stations - 1}]"

    def _of(self, linkage: int, quantity: Expr, station: int | None = None) -> str:
        """Quantity of one linkage at its own station, or as if it were at another one."""
        at = self._stations[linkage] if station is None else station
        phase = float(self.machine.linkages[linkage].phase_rad)
        call = f"theta[{at}] + {phase!r}, omega[{at}], alpha[{at}]"
        row = self.rows.setdefault(call, len(self.rows))
        if quantity not in self.each:
            self.each.append(quantity)
        return f"z[{row}][{self.each.index(quantity)}]"

    def functions(self) -> list[str]:
        """C functions of the linkages."""
        made = []
        for name, quantities in (("tt_usual", self.usual), ("tt_each", self.each)):
            if quantities:
                made.append(c_function(f"static void {name}({_ONE})", quantities, "z"))
        return made

    def calls(self) -> list[str]:
        """C lines that evaluate them."""
        lines = []
        if self.usual:
            first = self._stations[0]
            lines += [f"double u[{len(self.usual)}];"]
        if self.each:
            lines += [f"double z[{len(self.rows)}][{len(self.each)}];"]
        if self.usual:
            lines += [f"tt_usual(theta[{first}], omega[{first}], alpha[{first}], u);"]
        return [*lines, *(f"tt_each({call}, z[{row}]);" for call, row in self.rows.items())]
