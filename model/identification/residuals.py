"""Residuals and their slopes for one campaign under one setting: what every fit, test and plan evaluates."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification import parameters as known
from model.identification.fit_options import IdentificationError, Setting
from model.identification.forward_model import Forward
from model.identification.observations import Campaign, observed

Array = NDArray[np.float64]


class Problem:
    """Residuals and Jacobian of one campaign under one setting.

    Raises:
        ParameterError: the setting does not fit the campaign.
        IdentificationError: nothing is free.
    """

    def __init__(self, campaign: Campaign, setting: Setting) -> None:
        self.campaign, self.setting = campaign, setting
        own = setting.names(campaign)
        if not own:
            raise IdentificationError("no parameter is free: name at least one that these runs can tell")
        self.names = (*own, *campaign.common)
        self.forward = Forward(campaign, self.names, setting.base(), setting.tied, setting.amplifier, setting.n)
        base = setting.base()
        self.start = np.array([setting.start.get(n, known.start_value(n, base)) for n in self.names])
        prior = {n: (0.0, e.standard_error) for n, e in campaign.common.items()} | dict(setting.known)
        self._prior = [(self.names.index(n), v, s) for n, (v, s) in prior.items()]
        self._data = [observed(run) for run in campaign.runs]
        limits = [known.quantity(n, campaign).interval for n in self.names]
        self.log = np.array([i.gt == 0 for i in limits]) & (self.start > 0)
        self.low = np.array([next((float(x) for x in (i.ge, i.gt) if x is not None), -np.inf) for i in limits])  # type: ignore[arg-type]
        self.high = np.array([next((float(x) for x in (i.le, i.lt) if x is not None), np.inf) for i in limits])  # type: ignore[arg-type]

    def evaluate(self, theta: Array) -> tuple[Array, Array]:
        """Residuals (rows,) and slopes of the predictions over their errors (rows, P)."""
        rows: list[Array] = []
        J: list[Any] = []
        for (y, error), got in zip(self._data, self.forward.predict(theta), strict=True):
            r, s = (y - got.values) / error, got.slopes / error
            parts = (r.real, r.imag) if np.iscomplexobj(r) else (r,)
            rows += parts
            J += [s.real.T, s.imag.T] if len(parts) == 2 else [s.T]
        for i, value, sigma in self._prior:
            rows.append(np.array([(value - theta[i]) / sigma]))
            one = np.zeros((1, theta.size))
            one[0, i] = 1 / sigma
            J.append(one)
        return np.concatenate(rows), np.concatenate(J)
