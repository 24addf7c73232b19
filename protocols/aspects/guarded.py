"""Guard around the aspects of a laboratory's protocol: an error of its code becomes a sentence, and does not end a list of runs."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import wraps
from typing import Any, cast

from model import ParameterError
from protocols.base import Aspects, Figure, TableImportError
from protocols.runfile import RunReadError

STATED = (RunReadError, ParameterError, TableImportError)
"""Errors that aspects may raise."""


class AspectsError(RunReadError, TableImportError):
    """A method of a laboratory's aspects failed; the message names protocol, method and error."""


class _GuardedAspects:
    def __init__(self, aspects: Aspects, protocol: str) -> None:
        self._aspects, self._protocol = aspects, protocol

    def __getattr__(self, name: str) -> Any:
        value = getattr(self._aspects, name)
        return self._guarded(value, name) if callable(value) else value

    def _guarded(self, method: Callable[..., Any], name: str) -> Callable[..., Any]:
        @wraps(method)
        def guarded(*arguments: Any, **options: Any) -> Any:
            try:
                result = method(*arguments, **options)
            except STATED:
                raise
            except Exception as error:
                raise self._failed(name, error) from error
            return self._iterated(result, name) if isinstance(result, Iterator) else result

        return guarded

    def _iterated(self, results: Iterator[Any], name: str) -> Iterator[Any]:
        try:
            for result in results:
                yield self._guarded_curves(result) if isinstance(result, Figure) else result
        except STATED:
            raise
        except Exception as error:
            raise self._failed(name, error) from error

    def _guarded_curves(self, figure: Figure) -> Figure:
        models = {label: self._guarded(curve, "model_curve") for label, curve in figure.models.items()}
        return replace(figure, model=figure.model and self._guarded(figure.model, "model_curve"), models=models)

    def _failed(self, name: str, error: Exception) -> AspectsError:
        return AspectsError(
            f"{name}() in the aspects of the protocol {self._protocol!r} failed: {type(error).__name__}: {error}; "
            "correct the protocol's file, or run without it"
        )


def guarded_aspects(aspects: Aspects, protocol: str) -> Aspects:
    """Return the aspects with methods that raise AspectsError instead of an unexpected error."""
    return cast("Aspects", _GuardedAspects(aspects, protocol))
