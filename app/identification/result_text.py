"""First lines of an identification: adequacy, source of the dimensions, and held parameters with their values."""

from app.identification.specimen_identification import IdentificationResult
from app.identification.specimen_sheet import sheet_unit
from model import Membrane, Tactor, format_quantity, format_with_uncertainty, parameter_specs
from model.identification import MembraneSagObservation

ADEQUACY_TEXT = {True: "adequate", False: "NOT ADEQUATE", None: "adequacy unknown"}
HELD_TEXT = "held as exact"
USED_PARAMETERS = tuple(q.name for q in parameter_specs(Tactor))
SKIN_PARAMETERS = tuple(q.name for q in parameter_specs(Membrane))


def verdict_line(identification: IdentificationResult) -> str:
    """Return the verdict on the model in one line: `adequate`, or `NOT ADEQUATE` with the first clause of the reason."""
    adequacy = identification.adequacy
    if adequacy is None:
        return "not tested"
    added = f" with {', '.join(step.name for step in identification.steps)} added" if identification.steps else ""
    verdict = f"{ADEQUACY_TEXT[adequacy.adequate]}{added}"
    return verdict if adequacy.adequate else f"{verdict}: {adequacy.message.partition(' (')[0]}"


def steps_line(identification: IdentificationResult, also: str, plain: str) -> str:
    """Return the causes added to an inadequate model, the outcome, and the way of agreement, as text.

    Args:
        identification: the fit.
        also: option that agrees to the causes.
        plain: option of a fit without causes.
    """
    if not identification.steps:
        return ""
    adequacy, names = identification.adequacy, [step.name for step in identification.steps]
    end = "adequate with them" if adequacy is not None and adequacy.adequate else "not adequate with them either"
    causes = "; ".join(step.explanation.cause_text for step in identification.steps)
    return (
        f"the model was not adequate by itself; added in turn, as its test proposed: {causes}; {end}. "
        f"To agree to it: {also} {','.join(names)}; the model without any of them: {plain}."
    )


def assumed_line(identification: IdentificationResult) -> str:
    """Return the parameters determined by neither sheet nor runs, with their assumed values, and the temperature of the results, as text."""
    shown = [format_quantity(e.value, e.standard_error, e.unit, e.name) for e in identification.assumed]
    names = [f"{e.name} {text}" for e, text in zip(identification.assumed, shown, strict=True)]
    rests = [
        f"{name} ({100 * share:.0f} % of its squared uncertainty)" for name, share in identification.resting.items()
    ]
    resting = f"; {', '.join(rests)} rests on it" if rests else ""
    assumed = f"assumed, because neither sheet nor runs determine it: {', '.join(names)}{resting}." if names else ""
    reference_c = identification.observations.reference_c
    stated = f"k2, mu and c0 are those at {reference_c:.1f} °C." if reference_c is not None else ""
    return " ".join(filter(None, (assumed, stated)))


def held_parameters(identification: IdentificationResult, hint: str = "") -> str:
    """Return the parameters that the fit held, with their values, as text; an error of one is in no standard error.

    Args:
        identification: the fit.
        hint: how to give a value its uncertainty.
    """
    runs = identification.observations.runs
    skin = any(
        getattr(run, "elongation_m", None) is not None or isinstance(run, MembraneSagObservation) for run in runs
    )
    names = (*USED_PARAMETERS, *(SKIN_PARAMETERS if skin else ()))
    shown, fit = [], identification.joint_fit
    free = () if fit is None else fit.names
    for name in names:
        value = None if name in free else identification.fixed.get(name)
        if value is not None:
            factor, text = sheet_unit(name)
            shown.append(f"{name} {factor * value:.4g} {text}".strip())
    if not shown:
        return ""
    return f"{HELD_TEXT}{f' ({hint})' if hint else ''}: {', '.join(shown)}."


def dimensions_line(identification: IdentificationResult, remedy: str = "") -> str:
    """Return the origin of the dimensions and masses of a fit, with their uncertainties, as text.

    Args:
        identification: the fit.
        remedy: how to write a sheet, for a specimen without one.
    """
    sheet = identification.sheet
    if sheet is None:
        return ""
    stated = []
    for name, (value, uncertainty) in identification.dimensions.items():
        factor, unit = sheet_unit(name)
        stated.append(f"{name} {format_with_uncertainty(factor * value, factor * uncertainty)} {unit}".strip())
    without = f"; {remedy}" if remedy and sheet.path is None else ""
    return f"{sheet.description}{without}{': ' if stated else ''}{', '.join(stated)}."
