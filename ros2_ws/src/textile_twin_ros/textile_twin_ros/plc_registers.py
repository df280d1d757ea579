# Copyright 2026 textile-twin contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
#
# SPDX-License-Identifier: Apache-2.0

"""Values in the registers of a PLC (Modbus): address and type of each, all read in one request."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from textile_twin_core.errors import SceneError
from textile_twin_core.recordings.counter import CounterUnwrapper

TYPES = ("int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64")
BYTE_ORDERS = ("ABCD", "CDAB", "BADC", "DCBA")
_MOST_REGISTERS = 125
"""Of one request, by the Modbus specification."""


@dataclass(frozen=True)
class Register:
    """One value: its first register and its type."""

    address: int
    kind: str

    @classmethod
    def parse(cls, name: str, text: str) -> Register | None:
        """A register written as ADDRESS:TYPE, such as 4:float32; None for an empty text.

        Raises:
            SceneError: it is written otherwise.
        """
        if not text:
            return None
        address, _, kind = text.partition(":")
        if not address.isdecimal() or int(address) > 65535 or kind not in TYPES:
            raise SceneError(
                f"parameter '{name}' is '{text}': write ADDRESS:TYPE, such as 4:float32, with an address up to 65535"
                f" and one of the types {', '.join(TYPES)}"
            )
        return cls(int(address), kind)

    @property
    def length(self) -> int:
        """Number of its registers of 16 bits."""
        return int(self.kind.lstrip("uintfloa")) // 16

    @property
    def counter_width(self) -> int | None:
        """Range of a whole number of 16 or 32 bits, after which it begins again; None for other types."""
        return None if self.is_float or self.length > 2 else 1 << 16 * self.length

    @property
    def is_float(self) -> bool:
        """True for a type with fractions."""
        return self.kind.startswith("float")


def nearest(kind: str, value: float) -> int | float:
    """The nearest to a finite value that this type, as numpy names it, can hold: a whole number if no others."""
    if kind.startswith("float"):
        most = float(np.finfo(kind).max)
        return min(max(value, -most), most)
    limits = np.iinfo(kind)
    return min(max(round(value), int(limits.min)), int(limits.max))


def counter_of(width: int | None, unit_rad: float) -> CounterUnwrapper | None:
    """Return the unwrapper of an angle that is a counter of this range; None where the range is a number of turns.

    Args:
        width: range of the counter in counts; None for a number that is no counter.
        unit_rad: angle of one count.
    """
    if width is None or abs(math.remainder(width * unit_rad, 2.0 * math.pi)) < 0.5 * unit_rad:
        return None
    return CounterUnwrapper([width], known=True)


class RefusedError(OSError):
    """The PLC answers, but does not take a value."""


class Registers:
    """Named values read in one request.

    Args:
        client: pymodbus's client.
        table: "holding" or "input".
        values: by name; None for those that the PLC does not have.
        device: the device's number on its line.
        byte_order: of `BYTE_ORDERS`: how the bytes A (highest) to D of a long value lie in its registers.

    Raises:
        SceneError: the values lie too far apart for one request.
    """

    def __init__(
        self, client: Any, table: str, values: dict[str, Register | None], device: int, byte_order: str = "ABCD"
    ) -> None:
        self._client, self._device = client, device
        self._word_order = "big" if byte_order.index("A") < byte_order.index("C") else "little"
        self._swapped = byte_order.index("B") < byte_order.index("A")
        self._request = client.read_holding_registers if table == "holding" else client.read_input_registers
        self._values = {name: value for name, value in values.items() if value is not None}
        self._first = min(value.address for value in self._values.values())
        self._count = max(value.address + value.length for value in self._values.values()) - self._first
        if self._count > _MOST_REGISTERS:
            raise SceneError(
                f"the registers span {self._count}, more than the {_MOST_REGISTERS} of one Modbus request: let the PLC"
                " put them side by side, so that they are of one moment"
            )

    def read(self) -> dict[str, float]:
        """All values.

        Raises:
            OSError: the PLC does not answer, or answers with a Modbus exception.
        """
        answer = self._request(self._first, count=self._count, device_id=self._device)
        if answer.isError():
            raise OSError(f"the PLC answers {answer}")
        return {name: self._decode(answer.registers, value) for name, value in self._values.items()}

    def write(self, register: Register, value: float) -> None:
        """Write one value into holding registers, the nearest that they can hold.

        Raises:
            RefusedError: the PLC does not take it.
            OSError: the PLC does not answer.
        """
        kind = self._client.DATATYPE[register.kind.upper()]
        words = self._ordered(self._client.convert_to_registers(nearest(register.kind, value), kind, self._word_order))
        answer = self._client.write_registers(register.address, words, device_id=self._device)
        if answer.isError():
            raise RefusedError(f"the PLC does not take register {register.address}: {answer}")

    def _decode(self, words: list[int], register: Register) -> float:
        start = register.address - self._first
        kind = self._client.DATATYPE[register.kind.upper()]
        own = self._ordered(words[start : start + register.length])
        value = self._client.convert_from_registers(own, kind, self._word_order)
        return value if isinstance(value, int) else float(value)

    def _ordered(self, words: list[int]) -> list[int]:
        """Exchange the bytes of each register where the PLC has the lower one first."""
        return [(word & 0xFF) << 8 | word >> 8 for word in words] if self._swapped else words
