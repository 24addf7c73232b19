"""What the runs of a campaign say together about the specimen, by the paper's chain; and what is believed of it meanwhile."""

from dataclasses import replace
from pathlib import Path

from app.campaign import Campaign
from app.config_tables import AmplifierTable
from app.identifying import Identified, identify
from app.observing import ObservingError
from model.amplifier import AmplifierMap
from model.identification.chain_method import ChainError
from model.identification.setting import Setting
from model.parameters import Tactor
from model.quantity import ParameterError
from protocols.runreader import Run, RunError


def identified(campaign: Campaign, amplifier: AmplifierMap | None = None) -> Identified | str:
    """The parameters that the runs of a campaign tell so far; a sentence where they tell none.

    The chain goes in the campaign's order: what a later run cannot tell does not take away what the earlier ones do.
    """
    runs, why = campaign.counting(), "no run of this campaign counts yet"
    for last in range(len(runs), 0, -1):
        try:
            found = identify(runs[:last], "chain", Setting(amplifier=amplifier or _amplifier_of(runs[0])))
        except (RunError, ObservingError, ChainError, ParameterError) as error:
            why = str(error)
        else:
            return found if last == len(runs) else replace(found, notes=(*found.notes, why))
    return why


def _amplifier_of(path: Path) -> AmplifierMap:
    """The amplifier as it was in a run: its map is copied into every run file."""
    with Run(path) as run:
        return AmplifierTable.of(run.configuration).map


def believed(campaign: Campaign, amplifier: AmplifierMap | None = None) -> Tactor:
    """The specimen as far as it is known: what was identified, and the paper's Table I for the rest."""
    found = identified(campaign, amplifier)
    return Tactor() if isinstance(found, str) else found.tactor
