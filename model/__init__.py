"""Model of the tactor: parameters, specimen, skin and amplifier map; responses and identification are sub-packages.

Each name is imported when it is first used, so that the package costs nothing at start-up.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from model.amplifier_map import AmplifierMap
    from model.estimate import EstimatedQuantity
    from model.parameter_spec import ParameterError, ParameterSpec, parameter_specs
    from model.parameters import Beam, Membrane, Tactor
    from model.skin import Skin
    from model.specimen import Specimen

_MODULES = {
    "model.amplifier_map": "AmplifierMap",
    "model.estimate": "EstimatedQuantity",
    "model.parameter_spec": "ParameterError ParameterSpec parameter_specs",
    "model.parameters": "Beam Membrane Tactor",
    "model.skin": "Skin",
    "model.specimen": "Specimen",
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names.split()}

__all__ = [
    "AmplifierMap",
    "Beam",
    "EstimatedQuantity",
    "Membrane",
    "ParameterError",
    "ParameterSpec",
    "Skin",
    "Specimen",
    "Tactor",
    "parameter_specs",
]

if not TYPE_CHECKING:  # a checker would take any name for one of the package

    def __getattr__(name: str) -> Any:
        if name not in _MODULE_OF:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        value = globals()[name] = getattr(import_module(_MODULE_OF[name]), name)
        return value
