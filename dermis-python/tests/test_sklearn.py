"""The calibration as a scikit-learn estimator."""

import doctest
import pickle

import numpy as np
import pytest

pytest.importorskip("sklearn")
from sklearn.base import clone  # noqa: E402
from sklearn.utils.estimator_checks import check_estimator  # noqa: E402

import dermis.sklearn  # noqa: E402

# A calibration is of one skin: the number of features is that of its channels, and targets are positions in space. The
# checks below give data of other sizes, or one target.
OTHER_SIZES = "the features are the channels of a skin, the targets positions in space"
NOT_APPLICABLE = [
    "check_dict_unchanged",
    "check_dont_overwrite_parameters",
    "check_dtype_object",
    "check_estimators_dtypes",
    "check_estimators_fit_returns_self",
    "check_estimators_nan_inf",
    "check_estimators_overwrite_params",
    "check_estimators_pickle",
    "check_f_contiguous_array_estimator",
    "check_fit2d_1feature",
    "check_fit2d_1sample",
    "check_fit2d_predict1d",
    "check_fit_check_is_fitted",
    "check_fit_idempotent",
    "check_fit_score_takes_y",
    "check_methods_sample_order_invariance",
    "check_methods_subset_invariance",
    "check_n_features_in",
    "check_n_features_in_after_fitting",
    "check_pipeline_consistency",
    "check_positive_only_tag_during_fit",
    "check_readonly_memmap_input",
    "check_regressor_data_not_an_array",
    "check_regressors_int",
    "check_regressors_no_decision_function",
    "check_regressors_train",
    "check_supervised_y_2d",
]


def test_the_example_of_the_module_runs():
    result = doctest.testmod(dermis.sklearn)
    assert result.attempted and not result.failed


def test_checks_of_scikit_learn_that_apply():
    results = check_estimator(
        dermis.sklearn.CalibrationRegressor("skin16"),
        expected_failed_checks=dict.fromkeys(NOT_APPLICABLE, OTHER_SIZES),
        on_fail=None,
        on_skip=None,
    )
    unexpected = [(result["check_name"], result["exception"]) for result in results if result["status"] == "failed"]
    assert not unexpected, unexpected
    passed = {result["check_name"] for result in results if result["status"] == "passed"}
    assert {"check_no_attributes_set_in_init", "check_parameters_default_constructible"} <= passed
    # Every exception is needed.
    expected = {result["check_name"] for result in results if result["status"] == "xfail"}
    assert expected == set(NOT_APPLICABLE), expected ^ set(NOT_APPLICABLE)


def test_a_clone_predicts_the_same():
    skin = dermis.Skin.load("skin16")
    rng = np.random.default_rng(1)
    inside = skin.pixels[np.abs(skin.pixels - skin.pixels.mean(axis=0)).max(axis=1) < 0.4 * np.ptp(skin.pixels)]
    positions = rng.choice(inside, 40, replace=False)
    twin = skin.twin("lab", seed=1)
    differences = twin.press(positions) - twin.untouched(100).mean(axis=0)
    calibration = dermis.sklearn.CalibrationRegressor("skin16")
    first = calibration.fit(differences, positions).predict(differences)
    second, sd = clone(calibration).fit(differences, positions).predict(differences, return_std=True)
    assert np.array_equal(first, second)
    assert np.array_equal(pickle.loads(pickle.dumps(calibration)).predict(differences), first)
    assert np.linalg.norm(first - positions, axis=1).mean() < 0.003
    assert calibration.score(differences, positions) > 0.9
    assert (sd > 0).all()
