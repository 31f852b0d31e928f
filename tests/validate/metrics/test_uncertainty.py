"""Scores of covariances: against scipy, and on errors drawn from the covariance itself."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats
from scipy.spatial.transform import Rotation

from roundel.scenes.geometry.pose import minimal_rotation
from roundel.validate.metrics.uncertainty import (
    brier_score,
    choice_score,
    percentile_of,
    tail_of,
    uncertainty_scores,
)


def drawn(rng: np.random.Generator, count: int) -> tuple[np.ndarray, ...]:
    """Estimates, their covariances of rank five, and true poses that are drawn from them; the errors as well."""
    normal = rng.normal(size=(count, 3)) * [0.5, 0.5, 0.1] - [0, 0, 1]
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    centre = rng.normal(size=(count, 3)) * 0.1 + [0, 0, 1]
    axes = np.swapaxes(minimal_rotation(np.broadcast_to([0.0, 0.0, 1.0], normal.shape), normal)[:, :, :2], 1, 2)
    root = rng.normal(size=(count, 5, 5)) * np.array([1e-3, 1e-3, 5e-3, 2e-3, 2e-3])[:, None]
    five = root @ np.swapaxes(root, 1, 2)
    basis = np.zeros((count, 5, 6))
    basis[:, :3, :3], basis[:, 3:, 3:] = np.eye(3), axes
    cov = np.swapaxes(basis, 1, 2) @ five @ basis
    error = np.einsum("nij,nj->ni", root, rng.normal(size=(count, 5)))
    pose = np.tile(np.eye(4), (count, 1, 1))
    for i in range(count):
        tangent = error[i, 3:] @ axes[i]
        turn = Rotation.from_rotvec(np.cross(normal[i], tangent)).as_matrix()
        pose[i, :3, :3] = turn @ minimal_rotation([0.0, 0.0, 1.0], normal[i])
    pose[:, :3, 3] = centre + error[:, :3]
    return pose, normal, centre, cov, error, five


@given(st.integers(0, 10_000))
def test_scores_are_those_of_scipy(seed: int) -> None:
    pose, normal, centre, cov, error, five = drawn(np.random.default_rng(seed), 3)
    found = uncertainty_scores(pose, normal, centre, cov)
    for i in range(3):
        if np.linalg.cond(five[i] / np.sqrt(np.outer(*[np.diag(five[i])] * 2))) > 1e6:
            continue  # of a nearly singular covariance, digits are lost in both
        density = stats.multivariate_normal(np.zeros(5), five[i], allow_singular=False)
        assert found.log_score[i] == pytest.approx(-density.logpdf(error[i]), rel=1e-9, abs=1e-9)
        assert found.chi2[i] == pytest.approx(error[i] @ np.linalg.solve(five[i], error[i]), rel=1e-8)
        assert percentile_of(found.chi2[i]) == pytest.approx(stats.chi2(5).cdf(found.chi2[i]), abs=1e-12)
        assert tail_of(found.chi2[i]) == pytest.approx(stats.chi2(5).sf(found.chi2[i]), rel=1e-12)
        assert found.position_sigma_m[i] == pytest.approx(np.sqrt(np.trace(five[i][:3, :3])), rel=1e-9)
        assert found.normal_sigma_deg[i] == pytest.approx(np.degrees(np.sqrt(np.trace(five[i][3:, 3:]))), rel=1e-9)


def test_errors_of_the_covariance_itself_are_chi_square() -> None:
    pose, normal, centre, cov, _, _ = drawn(np.random.default_rng(1), 3000)
    percentile = percentile_of(uncertainty_scores(pose, normal, centre, cov).chi2)
    assert np.isfinite(percentile).all()
    assert stats.kstest(percentile, "uniform").pvalue > 0.01
    # Half the standard deviations: the truth is outside of what they say.
    narrow = percentile_of(uncertainty_scores(pose, normal, centre, cov / 4).chi2)
    assert np.mean(narrow > 0.95) > 0.4
    # And a proper score is worse, on either side.
    right, small, large = (
        np.mean(uncertainty_scores(pose, normal, centre, k * cov).log_score) for k in (1.0, 0.25, 4.0)
    )
    assert right < small
    assert right < large


def test_depth_is_along_the_line_of_sight() -> None:
    cov = np.diag([1e-6, 4e-6, 9e-6, 1e-6, 1e-6, 0.0])[None]
    pose = np.eye(4)[None].copy()
    pose[0, :3, 3] = [0, 0, 2]
    found = uncertainty_scores(pose, [[0.0, 0.0, 1.0]], [[0.0, 0.0, 2.0]], cov)
    assert found.depth_sigma_m[0] == pytest.approx(3e-3)
    assert found.chi2[0] == 0.0
    assert found.position_sigma_m[0] == pytest.approx(np.sqrt(14e-6))


@pytest.mark.parametrize("wrong", ["missing", "negative", "singular", "no pose"])
def test_what_is_no_covariance_has_no_score(wrong: str) -> None:
    pose, normal, centre, cov, _, _ = drawn(np.random.default_rng(2), 2)
    if wrong == "no pose":
        normal[0] = np.nan
    else:
        cov[0] = {"missing": np.full((6, 6), np.nan), "negative": -cov[0], "singular": np.zeros((6, 6))}[wrong]
    found = uncertainty_scores(pose, normal, centre, cov)
    for values in vars(found).values():
        assert np.isnan(values[0])
        assert np.isfinite(values[1])


@given(st.lists(st.tuples(st.floats(1e-5, 1 - 1e-5), st.booleans()), min_size=1, max_size=30))
def test_scores_of_probabilities_are_those_of_a_bernoulli_variable(cases: list[tuple[float, bool]]) -> None:
    stated, right = (np.array(v) for v in zip(*cases, strict=True))
    variable = stats.bernoulli(stated)
    assert choice_score(stated, right) == pytest.approx(-variable.logpmf(right.astype(int)), rel=1e-9)
    # The Brier score is the square of the distance between two distributions over two outcomes, halved.
    both = np.stack([variable.pmf(0) - ~right, variable.pmf(1) - right])
    assert brier_score(stated, right) == pytest.approx(np.sum(both**2, axis=0) / 2, rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("score", [choice_score, brier_score])
@given(truth=st.floats(0.02, 0.98), stated=st.floats(0.02, 0.98))
def test_the_true_probability_has_the_best_expected_score(score, truth: float, stated: float) -> None:
    def expected(p: float) -> float:
        return float(truth * score(p, True) + (1 - truth) * score(p, False))

    assert expected(truth) <= expected(stated) + 1e-12


def test_a_certainty_that_is_wrong_has_a_finite_score() -> None:
    assert choice_score(1.0, False) == pytest.approx(-np.log(1e-6))
    assert choice_score(0.0, True) == pytest.approx(-np.log(1e-6))
    assert brier_score(1.0, False) == 1.0
