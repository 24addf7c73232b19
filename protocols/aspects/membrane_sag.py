"""Aspects of the protocol `membrane-sag`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from model import identification
from protocols import measurements
from protocols.base import REPEAT_ALIASES, Aspects, ImportColumn, ImportedTable, ImportForm

if TYPE_CHECKING:
    from model.identification import Observation
    from protocols.aspects.run_points import RunPoints


class MembraneSagAspects(Aspects):
    """Membrane sag beside its measurement."""

    import_form = ImportForm(
        columns=(
            ImportColumn("sag", "m", "depth of the membrane's centre", ("durchhang", "sagging", "membranesag"), (1e-5, 5e-2)),
            ImportColumn("repeat", "1", "number of the repeat; counted automatically if missing", REPEAT_ALIASES),
        ),
        required=(("sag",),),
    )  # fmt: skip

    def complete_table(self, table: ImportedTable) -> None:
        table.values.setdefault("repeat", np.arange(1.0, table.rows + 1))
        table.parameters.update(measurements.MembraneSag(**table.parameters).model_dump(mode="json"))
        table.warnings.append(
            "the strip's geometry and weight are the protocol's unless changed with --set: see 'parameters'"
        )

    short_name = "sag"

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        """Yield the mean sag: errors common to the repeats (reference depth, geometry) do not average out."""
        if not points.good.any():
            return
        given = points.read_protocol()
        assert isinstance(given, measurements.MembraneSag)
        sag, errors = (points.columns[name][points.good] for name in ("sag", "sag_errors"))
        mean_m, error_m = given.mean_sag(sag, errors)
        yield identification.MembraneSagObservation(
            points.label,
            np.array([mean_m]),
            np.array([given.combined_sag_error_m(mean_m, error_m)]),
            geometry=given.membrane,
            load_n_per_m=given.load_n_per_m,
            delta=given.elongation_m / given.length_m,
            **points.common_arguments("displacement"),
        )


ASPECTS = MembraneSagAspects()
