"""The modelDescription.xml of FMI 2.0 and 3.0: variables, dependencies and capabilities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from xml.etree import ElementTree as ET

_UNITS = {
    "_kgm2": "kg.m2", "_rad_s2": "rad/s2", "_rad_s": "rad/s", "_m_s2": "m/s2", "_m_s": "m/s", "_Nms": "N.m.s",
    "_Nm_rad": "N.m/rad", "_Ns_m": "N.s/m", "_N_m": "N/m", "_Nm": "N.m", "_rad": "rad", "_kg": "kg", "_N": "N",
    "_J": "J", "_m": "m", "_s": "s",
}  # fmt: skip
"""Units by the suffix of a name, longest first."""
_BASE = {
    "kg.m2": {"kg": 1, "m": 2}, "rad/s2": {"rad": 1, "s": -2}, "rad/s": {"rad": 1, "s": -1}, "m/s2": {"m": 1, "s": -2},
    "m/s": {"m": 1, "s": -1}, "N.m.s": {"kg": 1, "m": 2, "s": -1}, "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.s/m": {"kg": 1, "s": -1}, "N/m": {"kg": 1, "s": -2}, "N.m": {"kg": 1, "m": 2, "s": -2}, "rad": {"rad": 1},
    "kg": {"kg": 1}, "N": {"kg": 1, "m": 1, "s": -2}, "J": {"kg": 1, "m": 2, "s": -2}, "m": {"m": 1}, "s": {"s": 1},
}  # fmt: skip


@dataclass(frozen=True)
class Variable:
    """A variable: its reference, causality and dependencies; None where it depends on everything."""

    name: str
    reference: int
    causality: str
    variability: str = "continuous"
    initial: str | None = None
    start: float | None = None
    derivative_of: str | None = None
    depends: tuple[str, ...] | None = ()
    description: str = ""

    @property
    def unit(self) -> str | None:
        """Unit by the suffix of the name."""
        name = self.name.partition("[")[0]
        return next((unit for end, unit in _UNITS.items() if name.endswith(end)), None)


@dataclass(frozen=True)
class ModelDescription:
    """Content of a model description.

    Attributes:
        name: name of the machine.
        identifier: C identifier of the model.
        token: identifies the model description.
        about: one line on the machine.
        variables: all variables.
        sources: names of the C files.
        indicators: number of event indicators.
        kinds: interfaces that the unit offers, "ModelExchange" and "CoSimulation".
        step_s: default step of a simulation [s].
    """

    name: str
    identifier: str
    token: str
    about: str
    variables: Sequence[Variable]
    sources: Sequence[str]
    indicators: int
    kinds: Sequence[str] = ("ModelExchange", "CoSimulation")
    step_s: float = 1e-3
    index: Mapping[str, int] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "index", {v.name: k for k, v in enumerate(self.variables, 1)})

    def xml(self, fmi: int) -> bytes:
        """Return the model description of FMI 2.0 or 3.0."""
        root = self._fmi2() if fmi == 2 else self._fmi3()
        ET.indent(root)
        return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True))

    def build_description(self) -> bytes:
        """Return sources/buildDescription.xml of FMI 3.0."""
        root = ET.Element("fmiBuildDescription", fmiVersion="3.0")
        configuration = ET.SubElement(root, "BuildConfiguration", modelIdentifier=self.identifier)
        files = ET.SubElement(configuration, "SourceFileSet", language="C99")
        for name in self.sources:
            ET.SubElement(files, "SourceFile", name=name)
        ET.indent(root)
        return bytes(ET.tostring(root, encoding="UTF-8", xml_declaration=True))

    @property
    def _outputs(self) -> list[Variable]:
        return [v for v in self.variables if v.causality == "output"]

    @property
    def _derivatives(self) -> list[Variable]:
        return [v for v in self.variables if v.derivative_of]

    @property
    def _unknown_at_start(self) -> list[Variable]:
        states = {v.derivative_of for v in self._derivatives}
        known = (v for v in self.variables if v.initial == "calculated")
        return [v for v in known if v.causality == "output" or v.derivative_of or v.name in states]

    def _root(self, **attributes: str) -> ET.Element:
        also = {
            "modelName": self.name,
            "description": self.about,
            "generationTool": f"textile-twin {version('textile-twin-core')}",
            "variableNamingConvention": "flat",
        }
        return ET.Element("fmiModelDescription", attributes | also)

    def _units(self, root: ET.Element) -> None:
        units = ET.SubElement(root, "UnitDefinitions")
        for name in sorted({v.unit for v in self.variables if v.unit}):
            unit = ET.SubElement(units, "Unit", name=name)
            ET.SubElement(unit, "BaseUnit", {k: str(n) for k, n in _BASE[name].items()})

    def _fmi2(self) -> ET.Element:
        root = self._root(fmiVersion="2.0", guid=self.token)
        root.set("numberOfEventIndicators", str(self.indicators))
        for kind in self.kinds:
            able = {"canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"}
            if kind == "CoSimulation":
                able["canHandleVariableCommunicationStepSize"] = "true"
            element = ET.SubElement(root, kind, {"modelIdentifier": self.identifier, **able})
            files = ET.SubElement(element, "SourceFiles")
            for name in self.sources:
                ET.SubElement(files, "File", name=name)
        self._units(root)
        ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="1.0", stepSize=repr(self.step_s))
        listed = ET.SubElement(root, "ModelVariables")
        for v in self.variables:
            scalar = ET.SubElement(listed, "ScalarVariable", self._attributes(v))
            real = ET.SubElement(scalar, "Real")
            if v.unit:
                real.set("unit", v.unit)
            if v.start is not None:
                real.set("start", repr(v.start))
            if v.derivative_of:
                real.set("derivative", str(self.index[v.derivative_of]))
        structure = ET.SubElement(root, "ModelStructure")
        for name, several in (
            ("Outputs", self._outputs),
            ("Derivatives", self._derivatives),
            ("InitialUnknowns", self._unknown_at_start),
        ):
            if several:
                group = ET.SubElement(structure, name)
                for v in several:
                    attributes = {}
                    if name != "InitialUnknowns" and v.depends is not None:
                        on = " ".join(str(k) for k in sorted(self.index[d] for d in v.depends))
                        attributes = {"dependencies": on}
                    ET.SubElement(group, "Unknown", {"index": str(self.index[v.name]), **attributes})
        return root

    def _fmi3(self) -> ET.Element:
        root = self._root(fmiVersion="3.0", instantiationToken=self.token)
        reference = {v.name: str(v.reference) for v in self.variables}
        for kind in self.kinds:
            able = {"canGetAndSetFMUState": "true", "canSerializeFMUState": "true"}
            if kind == "CoSimulation":
                able["canHandleVariableCommunicationStepSize"] = "true"
            ET.SubElement(root, kind, {"modelIdentifier": self.identifier, **able})
        self._units(root)
        ET.SubElement(root, "DefaultExperiment", startTime="0.0", stopTime="1.0", stepSize=repr(self.step_s))
        listed = ET.SubElement(root, "ModelVariables")
        for v in self.variables:
            attributes = self._attributes(v)
            if v.unit:
                attributes["unit"] = v.unit
            if v.start is not None:
                attributes["start"] = repr(v.start)
            if v.derivative_of:
                attributes["derivative"] = reference[v.derivative_of]
            ET.SubElement(listed, "Float64", attributes)
        structure = ET.SubElement(root, "ModelStructure")
        for name, several in (
            ("Output", self._outputs),
            ("ContinuousStateDerivative", self._derivatives),
            ("InitialUnknown", self._unknown_at_start),
        ):
            for v in several:
                on = {}
                if name != "InitialUnknown" and v.depends is not None:
                    on = {"dependencies": " ".join(reference[d] for d in v.depends)}
                ET.SubElement(structure, name, {"valueReference": reference[v.name], **on})
        for v in self.variables:
            if v.name.startswith("event_indicator"):
                ET.SubElement(structure, "EventIndicator", valueReference=reference[v.name])
        return root

    @staticmethod
    def _attributes(v: Variable) -> dict[str, str]:
        attributes = {"name": v.name, "valueReference": str(v.reference)}
        if v.description:
            attributes["description"] = v.description
        attributes |= {"causality": v.causality, "variability": v.variability}
        if v.initial is not None:
            attributes["initial"] = v.initial
        return attributes
