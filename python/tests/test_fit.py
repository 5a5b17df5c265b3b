"""ln L, gradients and coordinates: the numbers of the library, for arrays of every shape and any number of threads."""

import json
import multiprocessing
import pickle
import threading
from math import erf, sqrt

import numpy as np
import pytest
from conftest import QUICK_FIT, TRACK

import oblate


def lines(names, points):
    return "".join(json.dumps(dict(zip(names, point.tolist()))) + "\n" for point in points)


def test_values_and_gradients_are_those_of_the_command(fit, points, command):
    answers = command("evaluate", TRACK, "--gradient", given=lines(fit.names, points)).splitlines()
    assert len(answers) == len(points)
    values, gradients = fit.gradient(points)
    for answer, value, gradient in zip(map(json.loads, answers), values, gradients):
        assert value == answer["ln_likelihood"]
        assert gradient.tolist() == [answer["gradient"][name] for name in fit.names]
    assert fit.ln_likelihood(points).tolist() == values.tolist()


def test_points_of_a_batch_have_the_values_that_they_have_alone(fit, points):
    many = np.repeat(points, 150, axis=0)
    values, gradients = fit.gradient(many)
    assert values.shape == (300,)
    assert gradients.shape == (300, 13)
    for point, value, gradient in zip(points, values[::150], gradients[::150]):
        alone, gradient_alone = fit.gradient(point)
        assert isinstance(alone, float)
        assert gradient_alone.shape == (13,)
        assert alone == value == fit.ln_likelihood(point)
        assert (gradient_alone == gradient).all()
    assert (values.reshape(2, 150) == values[::150, None]).all()


def test_optional_parameters_are_columns_where_they_are_present(fit, points):
    settings = {
        "prior.marginals.phi0_deg": {"kind": "uniform", "lo": -30.0, "hi": 30.0},
        "prior.fixed.distance_factor": 1.0,
    }
    other = oblate.Fit(TRACK, settings=settings)
    assert other.names == [*fit.names, "phi0_deg"]
    assert other.units[-1] == "deg"
    assert other.fixed == {"distance_factor": 1.0}
    assert fit.fixed == {}
    # An angle of zero is none.
    values, gradients = other.gradient(np.column_stack([points, np.zeros(len(points))]))
    expected, by_required = fit.gradient(points)
    assert values.tolist() == expected.tolist()
    assert (gradients[:, :-1] == by_required).all()
    assert (gradients[:, -1] != 0).any()


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_values_have_the_same_bits_on_any_number_of_threads(fit, points, threads):
    other = oblate.Fit(TRACK, threads=threads)
    for given in [points, points[0]]:
        for one, two in zip(fit.gradient(given), other.gradient(given)):
            assert np.asarray(one).tobytes() == np.asarray(two).tobytes()


def test_arrays_of_any_layout_and_lists_are_read(fit, points):
    expected = fit.ln_likelihood(points).tolist()
    wide = np.zeros((2, 26))
    wide[:, ::2] = points
    misaligned = np.frombuffer(b" " + points.tobytes(), offset=1).reshape(2, 13)
    assert not misaligned.flags.aligned
    for given in [np.asfortranarray(points), wide[:, ::2], misaligned, points.tolist(), points.astype(">f8")]:
        assert fit.ln_likelihood(given).tolist() == expected
    assert fit.ln_likelihood(np.zeros((0, 13))).shape == (0,)
    assert fit.gradient(np.zeros((0, 13)))[1].shape == (0, 13)


@pytest.mark.parametrize("shape", [(), (12,), (14,), (2, 12), (13, 2), (1, 1, 13)])
def test_other_shapes_are_refused(fit, shape):
    for function in [fit.ln_likelihood, fit.gradient, fit.rejected, fit.prior_transform, fit.derived]:
        with pytest.raises(oblate.OblateError, match=r"give the shape \[13\] for one point, or \[n, 13\]"):
            function(np.full(shape, 0.5))


def test_what_is_no_number_is_refused(fit):
    with pytest.raises(ValueError, match="could not convert"):
        fit.ln_likelihood(["a"] * 13)
    with pytest.raises(oblate.OblateError, match="coordinates = x: give one of theta, u, z"):
        fit.ln_likelihood(np.zeros(13), coordinates="x")


def coordinates_of(fit, theta, coordinates):
    z = fit.z_from_theta(theta)
    return {"theta": theta, "z": z, "u": np.array([0.5 * (1.0 + erf(x / sqrt(2.0))) for x in z])}[coordinates]


@pytest.mark.parametrize("coordinates", ["theta", "z", "u"])
def test_gradients_match_central_differences(points, coordinates):
    # Rounding to single precision would be larger than the differences.
    fit = oblate.Fit(TRACK, settings={"model.precision": "double"})
    theta = points[1].copy()
    theta[fit.names.index("r_s_prog_kpc")] = 1.2  # its own value is the bound of the prior
    point = coordinates_of(fit, theta, coordinates)
    value, gradient = fit.gradient(point, coordinates=coordinates)
    np.testing.assert_allclose(value, fit.ln_likelihood(theta), rtol=1e-9)
    steps = 1e-7 * np.maximum(np.abs(point), 0.1)
    plus = fit.ln_likelihood(point + np.diag(steps), coordinates=coordinates)
    minus = fit.ln_likelihood(point - np.diag(steps), coordinates=coordinates)
    # By the curvature of ln L within a step, and by its rounding over a step.
    np.testing.assert_allclose((plus - minus) / (2.0 * steps), gradient, rtol=2e-3)


def test_rejected_points_have_a_cause_and_no_numbers(fit, points):
    given = np.repeat(points[:1], 4, axis=0)
    given[1, 3] = np.nan
    given[2, 0] = 14.1
    given[3, 7] = np.inf
    causes = [None, "bad_parameter", "outside_prior", "bad_parameter"]
    assert fit.rejected(given) == causes
    assert [fit.rejected(point) for point in given] == causes
    values, gradients = fit.gradient(given)
    assert np.isfinite(values[0])
    assert (values[1:] == -np.inf).all()
    assert np.isfinite(gradients[0]).all()
    assert np.isnan(gradients[1:]).all()


def test_a_rejecting_likelihood_says_that_the_track_is_not_covered(points):
    strict = oblate.Fit(TRACK, settings={"likelihood.coverage": "reject"})
    far = points[1].copy()
    far[strict.names.index("age_gyr")] = 1.0
    assert strict.rejected(far) == "uncovered"


def test_coordinates_invert_each_other_and_have_the_prior(fit):
    rng = np.random.default_rng(1)
    z = rng.normal(size=(2000, 13))
    theta = fit.theta_from_z(z)
    np.testing.assert_allclose(fit.z_from_theta(theta), z, atol=1e-9)
    assert fit.theta_from_z(z[0]).tolist() == theta[0].tolist()
    u = rng.uniform(size=(2000, 13))
    theta = fit.prior_transform(u)
    for column, u, prior in zip(theta.T, u.T, fit.prior.values()):
        match prior:
            case oblate.Uniform(lo=lo, hi=hi):
                np.testing.assert_allclose(column, lo + (hi - lo) * u)
            case oblate.Normal(mean=mean, sd=sd):
                below = [0.5 * (1.0 + erf((x - mean) / sd / sqrt(2.0))) for x in column]
                np.testing.assert_allclose(below, u, atol=1e-12)
            case oblate.HalfNormal(sd=sd):
                np.testing.assert_allclose([erf(x / sd / sqrt(2.0)) for x in column], u, atol=1e-12)


def test_the_prior_transform_refuses_what_is_outside_the_cube(fit):
    u = np.full((2, 13), 0.5)
    for outside in [-0.1, 1.1, np.nan]:
        u[1, 4] = outside
        with pytest.raises(oblate.OblateError, match="give numbers from 0 to 1"):
            fit.prior_transform(u)


def test_the_density_of_the_prior_is_the_product_of_its_marginals(fit, points):
    theta = dict(zip(fit.names, points[0]))
    expected = 0.0
    for name, prior in fit.prior.items():
        match prior:
            case oblate.Uniform(lo=lo, hi=hi):
                expected -= np.log(hi - lo)
            case oblate.Normal(mean=mean, sd=sd):
                expected -= 0.5 * ((theta[name] - mean) / sd) ** 2 + np.log(sd * np.sqrt(2.0 * np.pi))
            case oblate.HalfNormal(sd=sd):
                expected -= 0.5 * (theta[name] / sd) ** 2 + np.log(sd * np.sqrt(0.5 * np.pi))
    assert fit.ln_prior(points[0]) == pytest.approx(expected, rel=1e-12)
    assert fit.ln_prior(-points).tolist() == [-np.inf, -np.inf]


def test_q_is_uniform_under_the_prior(fit):
    derived = fit.derived(fit.prior_transform(np.random.default_rng(2).uniform(size=(10_000, 13))))
    q = np.sort(derived["q"])
    expected = 0.5 + (np.arange(10_000) + 0.5) / 10_000
    assert np.abs(q - expected).max() < 1.95 / np.sqrt(10_000)  # Kolmogorov-Smirnov, one in a thousand
    axis = np.array([derived["axis_x"], derived["axis_y"], derived["axis_z"]])
    np.testing.assert_allclose((axis**2).sum(axis=0), 1.0)
    one = fit.derived(fit.prior_transform(np.full(13, 0.5)))
    assert isinstance(one["q"], float)


def test_fixed_parameters_are_left_out(points):
    whole = oblate.Fit(TRACK, settings={"model.releases.particles": 512})
    quick = oblate.Fit(TRACK, config=QUICK_FIT)
    assert quick.names == ["log10_m_halo", "dir_x", "dir_y", "dir_z", "log10_m_prog"]
    assert quick.units == ["dex(solMass)", "", "", "", "dex(solMass)"]
    assert quick.dim == 5
    assert quick.fixed["age_gyr"] == 3.0
    point = np.array([12.0, 0.5, 0.2, 1.4, 7.7])
    values = {**quick.fixed, **dict(zip(quick.names, point))}
    theta = np.array([values[name] for name in whole.names])
    value, gradient = quick.gradient(point)
    expected, all_derivatives = whole.gradient(theta)
    assert value == expected
    free = [whole.names.index(name) for name in quick.names]
    assert gradient.tolist() == all_derivatives[free].tolist()


def test_settings_are_those_of_the_command(points):
    changes = {
        "model.releases.particles": 256,
        "likelihood.edges": "hard",
        "prior.marginals.age_gyr": {"kind": "uniform", "lo": 2.0, "hi": np.float64(3.5)},
        "sampling.nested.n_live": np.int64(700),
        "sampling.sampler": "nested",
    }
    fit = oblate.Fit(TRACK, settings=changes)
    assert fit.settings["model"]["releases"]["particles"] == 256
    assert fit.settings["likelihood"]["edges"] == "hard"
    assert fit.settings["sampling"]["nested"]["n_live"] == 700
    assert fit.prior["age_gyr"] == oblate.Uniform(2.0, 3.5)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"model.particels": 3}, "unknown field `particels`"),
        ({"model.releases.particles": "many"}, "invalid type: string"),
        ({"model.releases.particles": 7}, "model.releases.particles = 7"),
        ({"prior.fixed.age_gyr": 9.0}, "its prior has values from 1 to 4"),
        ({"seed": True}, "invalid type: boolean"),
    ],
)
def test_wrong_settings_are_refused_with_the_words_of_the_library(settings, message):
    with pytest.raises(oblate.OblateError, match=message):
        oblate.Fit(TRACK, settings=settings)


def test_what_no_setting_can_be_is_a_type_error():
    with pytest.raises(TypeError, match="cannot be a setting"):
        oblate.Fit(TRACK, settings={"seed": object()})
    with pytest.raises(oblate.OblateError, match="threads"):
        oblate.Fit(TRACK, threads=0)


def test_a_fit_can_be_pickled(points):
    fit = oblate.Fit(TRACK, settings={"model.releases.particles": 256}, threads=1)
    again = pickle.loads(pickle.dumps(fit))
    assert again.settings == fit.settings
    assert again.ln_likelihood(points).tolist() == fit.ln_likelihood(points).tolist()


@pytest.mark.filterwarnings("ignore:.*multi-threaded, use of fork:DeprecationWarning")
def test_batches_work_in_forked_processes(fit, points):
    expected = fit.ln_likelihood(points).tolist()
    # The threads of this process exist now, and not in its children.
    with multiprocessing.get_context("fork").Pool(1) as pool:
        assert pool.apply_async(fit.ln_likelihood, [points]).get(timeout=60).tolist() == expected


def test_other_threads_of_python_run_during_a_batch(fit, points):
    batch = np.repeat(points, 100, axis=0)
    worker = threading.Thread(target=fit.ln_likelihood, args=[batch])
    worker.start()
    steps = 0
    while worker.is_alive():
        steps += 1
    assert steps > 1000
