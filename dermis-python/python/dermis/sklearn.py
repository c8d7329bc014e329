"""Calibration of a real skin as a scikit-learn estimator.

>>> import dermis, numpy
>>> from dermis.sklearn import CalibrationRegressor
>>> skin = dermis.Skin.load("skin16")
>>> positions = skin.pixels[::40]
>>> twin = skin.twin("lab", seed=1)
>>> differences = twin.press(positions) - twin.untouched(100).mean(axis=0)
>>> calibration = CalibrationRegressor("skin16").fit(differences, positions)
>>> mean, sd = calibration.predict(differences, return_std=True)
>>> mean.shape, sd.shape
((22, 3), (22,))
"""

from os import PathLike
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from sklearn.base import BaseEstimator, RegressorMixin
from sklearn.utils.validation import check_is_fitted, validate_data

from dermis._dermis import Calibration, Skin


class CalibrationRegressor(RegressorMixin, BaseEstimator):
    """Positions of presses from differences of frames, by Gaussian-process regression on measured presses.

    The rows are presses in the order of recording: a viscoelastic skin remembers the press before.

    Args:
        design: A shipped name, the path of a design file, or a dict with its keys.

    Attributes:
        calibration_: The fitted `dermis.Calibration`.
    """

    calibration_: Calibration

    def __init__(self, design: str | PathLike[str] | dict[str, Any] = "cylinder30") -> None:
        self.design = design

    def fit(self, X: ArrayLike, y: ArrayLike) -> Self:
        """Fits the calibration.

        Args:
            X: Frames minus the untouched frame, (presses, channels), ohm.
            y: Positions of the presses, (presses, 3), m.
        """
        X, y = validate_data(self, X, y, multi_output=True, y_numeric=True, dtype=np.float64)
        self.calibration_ = Skin.load(self.design).calibrate(X, y, method="forward-map", force=True)
        return self

    def predict(self, X: ArrayLike, return_std: bool = False) -> Any:
        """Positions of presses.

        Args:
            X: Frames minus the untouched frame, (n, channels), ohm.
            return_std: Also return the standard deviation of each position per axis, (n,), m.

        Returns:
            (n, 3), m; with `return_std` also (n,), m.
        """
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float64)
        located = self.calibration_.locate(X, force=True)
        return (located["position_m"], located["sd_m"]) if return_std else located["position_m"]


__all__ = ["CalibrationRegressor"]
