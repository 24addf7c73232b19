"""Reference model: expected response of the free specimen, by calibration or by the paper's values."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import Any

import numpy as np

from model import AmplifierMap, Array, Tactor

PAPER_SOURCE = "the paper's values"


@dataclass(frozen=True, slots=True)
class ReferenceModel:
    """Model of the free specimen, for comparison with a run.

    Attributes:
        tactor: the specimen without skin.
        amplifier: static map of the bench's amplifier.
        source: origin of the parameters.
        calibrated: whether they were identified for this specimen.
    """

    tactor: Tactor = field(default_factory=Tactor)
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    source: str = PAPER_SOURCE
    calibrated: bool = False

    @property
    def resonance_hz(self) -> float:
        """Undamped natural frequency of the first mode."""
        from model.response import poles  # imported here: slow to load

        return float(abs(poles(self.tactor)[0])) / (2 * math.pi)

    def response(self, frequency_hz: Sequence[float], amplitude_v: float) -> Array:
        """Return the fundamental of the displacement under a sine around rest per volt of its amplitude, m/V, (F,)."""
        from model.response import amplifier_response  # imported here: slow to load

        answer = amplifier_response(self.tactor, frequency_hz, amplitude_v, self.amplifier.rest_v, self.amplifier)
        return np.asarray(abs(answer.fundamental) / amplitude_v)

    def as_record(self) -> dict[str, Any]:
        """Return the fields as plain values, for the run file."""
        return asdict(self)

    @classmethod
    def from_record(cls, record: Mapping[str, Any]) -> "ReferenceModel":
        """Return the reference of a record.

        Raises:
            KeyError, TypeError, ValueError: the record is not a reference.
        """
        return cls(
            Tactor(**_recorded_parameters(Tactor, record["tactor"])),
            AmplifierMap(**_recorded_parameters(AmplifierMap, record["amplifier"])),
            str(record["source"]),
            bool(record["calibrated"]),
        )


def _recorded_parameters(kind: type[Any], record: Mapping[str, Any]) -> dict[str, float]:
    return {each.name: float(record[each.name]) for each in fields(kind) if each.name in record}
