"""People and conditions of a run: operator, temperature and humidity, each with its origin."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RunConditions:
    """Operator, and the air in the laboratory.

    Attributes:
        operator: name of the operator; empty if unknown.
        operator_origin: origin of the name, e.g. `given` or `login of the computer`.
        temperature_c: air temperature, degrees Celsius; None if unknown.
        humidity: relative humidity of the air, 0 to 1; None if unknown.
        origin: origin of both: a sensor's identity, or the time of typing.
    """

    operator: str = ""
    operator_origin: str = ""
    temperature_c: float | None = None
    humidity: float | None = None
    origin: str = ""

    @property
    def air_text(self) -> str:
        """Temperature and humidity as text with their origin; empty without both."""
        parts = [
            "" if self.temperature_c is None else f"{self.temperature_c:.1f} °C",
            "" if self.humidity is None else f"{100 * self.humidity:.0f} % relative humidity",
        ]
        text = ", ".join(filter(None, parts))
        return f"{text} ({self.origin})" if text and self.origin else text
