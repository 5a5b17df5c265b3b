"""Both samplers on Python functions: exact answers, the same draws in every way of calling, and exceptions."""

import signal
import threading
import time

import numpy as np
import pytest

import oblate

WIDE = {"x": oblate.Uniform(-10.0, 10.0), "y": oblate.Uniform(-10.0, 10.0)}
SHORT = {"n_live": 100, "simulations": 20, "bootstraps": 20}


def bell(theta):
    """Independent standard normals; over WIDE, Z is 1/400."""
    return -0.5 * np.sum(theta**2, axis=-1) - np.log(2.0 * np.pi)


def bell_and_gradient(theta):
    return bell(theta), -theta


def to_wide(u):
    return 20.0 * u - 10.0


def same(one, two):
    return one.theta.tobytes() == two.theta.tobytes() and one.ln_z == two.ln_z


def check_bell(run):
    assert run.converged, run.checks
    assert abs(run.ln_z + np.log(400.0)) < 4.0 * run.ln_z_error
    assert 0.0 < run.ln_z_error < 0.3
    weights = np.exp(run.ln_weight)
    assert weights.sum() == pytest.approx(1.0)
    assert run.theta.shape == (len(run), 2)
    error = 1.0 / np.sqrt(run.ess)
    for column in run.theta.T:
        mean = weights @ column
        assert abs(mean) < 5.0 * error
        assert abs(weights @ (column - mean) ** 2 - 1.0) < 5.0 * np.sqrt(2.0) * error
    np.testing.assert_allclose(run.ln_likelihood, bell(run.theta))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_nested_sampling_finds_the_evidence_of_a_bell(seed):
    check_bell(oblate.sample(bell, WIDE, seed=seed))


def test_tempering_finds_the_evidence_of_a_bell():
    run = oblate.sample(bell, WIDE, gradient=bell_and_gradient, sampler="pt-hmc", settings={"rounds": 9})
    assert run.method == "pt-hmc"
    check_bell(run)


def test_tempering_without_a_gradient_needs_slice_updates():
    with pytest.raises(oblate.OblateError, match="parallel tempering needs gradients"):
        oblate.sample(bell, WIDE, sampler="pt-hmc")
    settings = {"rounds": 9, "hmc_transitions": 0, "slice_updates": 1}
    check_bell(oblate.sample(bell, WIDE, sampler="pt-hmc", settings=settings))


def test_a_prior_transform_gives_draws_in_physical_parameters():
    run = oblate.sample(bell, to_wide, names=["x", "y"])
    check_bell(run)
    assert run.names == ["x", "y"]
    assert run.derived == {}
    assert same(run, oblate.sample(bell, WIDE))


def test_all_ways_of_calling_give_the_same_draws():
    def one(theta):
        assert theta.shape == (2,)
        return bell(theta)

    def many(theta):
        assert theta.ndim == 2
        assert theta.shape[1] == 2
        return bell(theta)

    run = oblate.sample(one, WIDE, settings=SHORT, seed=5)
    assert same(run, oblate.sample(many, WIDE, vectorized=True, settings=SHORT, seed=5))
    assert same(run, oblate.sample(many, to_wide, names=["x", "y"], vectorized=True, settings=SHORT, seed=5))
    assert same(run, oblate.sample(one, WIDE, threads=3, settings=SHORT, seed=5))
    assert not same(run, oblate.sample(one, WIDE, settings=SHORT, seed=6))


def test_a_fit_is_a_function_like_any_other(fit):
    calls = oblate.sample(fit.ln_likelihood, fit.prior, vectorized=True, settings=SHORT, max_calls=300)
    assert calls.names == fit.names
    assert not calls.converged
    assert np.array_equal(fit.ln_likelihood(calls.theta), calls.ln_likelihood)


@pytest.mark.parametrize("where", ["ln_likelihood", "vectorized", "gradient", "prior_transform", "on_event"])
@pytest.mark.parametrize("threads", [1, 2])
def test_exceptions_come_through(where, threads):
    calls = 0
    mine = RuntimeError("mine")

    def fails(result):
        def function(argument):
            nonlocal calls
            calls += 1
            if calls > 20:
                raise mine
            return result(argument)

        return function

    options = {"threads": threads, "settings": {}}
    arguments = {"ln_likelihood": bell, "prior": WIDE}
    match where:
        case "ln_likelihood":
            arguments["ln_likelihood"] = fails(bell)
        case "vectorized":
            arguments["ln_likelihood"] = fails(bell)
            options["vectorized"] = True
        case "gradient":
            options |= {"sampler": "pt-hmc", "gradient": fails(bell_and_gradient)}
        case "prior_transform":
            arguments["prior"] = fails(to_wide)
            options["names"] = ["x", "y"]
        case "on_event":
            options["on_event"] = fails(lambda event: None)
    with pytest.raises(RuntimeError, match="mine") as raised:
        oblate.sample(**arguments, **options)
    assert raised.value is mine


def test_ctrl_c_ends_a_run():
    def slow(theta):
        time.sleep(0.002)
        return bell(theta)

    began = time.monotonic()
    timer = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        oblate.sample(slow, WIDE)
    assert time.monotonic() - began < 3.0
    timer.join()


def test_points_without_a_likelihood_are_counted():
    def half(theta):
        return -np.inf if theta[0] < 0.0 else (np.nan if theta[1] < 0.0 else bell(theta))

    run = oblate.sample(half, WIDE)
    assert run.converged
    assert abs(run.ln_z + np.log(1600.0)) < 4.0 * run.ln_z_error
    assert set(run.rejected) == {"nan", "zero likelihood"}


@pytest.mark.parametrize(
    ("function", "error", "message"),
    [
        (lambda theta: "a", TypeError, "must be real number"),
        (lambda theta: None, TypeError, "must be real number"),
        (lambda theta: np.inf, oblate.OblateError, r"log-likelihood is \+inf"),
        (lambda theta: -np.inf, oblate.OblateError, "none of 100000 prior draws"),
    ],
)
def test_what_is_no_likelihood_is_refused(function, error, message):
    with pytest.raises(error, match=message):
        oblate.sample(function, WIDE)


def test_arrays_of_another_shape_are_refused():
    with pytest.raises(oblate.OblateError, match=r"ln_likelihood\(theta\) = an array of shape \[2\]"):
        oblate.sample(lambda theta: np.zeros(2), WIDE, vectorized=True, settings=SHORT)
    with pytest.raises(oblate.OblateError, match=r"prior_transform\(u\) = an array of shape \[3\]"):
        oblate.sample(bell, lambda u: np.zeros(3), names=["x", "y"])
    with pytest.raises(oblate.OblateError, match=r"gradient\(theta\)\[1\] = an array of shape \[1\]"):
        oblate.sample(bell, WIDE, gradient=lambda theta: (0.0, [0.0]), sampler="pt-hmc")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"prior": WIDE, "sampler": "mcmc"}, "give `nested` or `pt-hmc`"),
        ({"prior": WIDE, "settings": {"n_lives": 3}}, "unknown field `n_lives`"),
        ({"prior": WIDE, "settings": {"n_live": 3}}, "n_live = 3"),
        ({"prior": {"x": oblate.Uniform(1.0, 1.0)}}, "give finite numbers with lo < hi"),
        ({"prior": {}}, "leave at least one parameter free"),
        ({"prior": 3}, "give a dictionary of marginals, or a function"),
        ({"prior": to_wide}, "names = missing"),
        ({"prior": to_wide, "names": []}, "give the name of each parameter"),
        ({"prior": WIDE, "names": ["x", "y"]}, "leave them out"),
        ({"prior": to_wide, "names": ["x", "y"], "gradient": bell_and_gradient}, "whose derivatives are known"),
        ({"prior": WIDE, "threads": 0}, "threads"),
    ],
)
def test_wrong_arguments_are_refused(arguments, message):
    with pytest.raises(oblate.OblateError, match=message):
        oblate.sample(bell, **arguments)


def test_events_tell_the_progress():
    events = []
    run = oblate.sample(bell, WIDE, settings=SHORT, on_event=events.append)
    kinds = [event["event"] for event in events]
    assert kinds[0] == "started"
    assert kinds[-1] == "finished"
    nested = [event for event in events if event["event"] == "nested"]
    assert nested[-1]["ln_z"] == pytest.approx(run.ln_z, abs=0.5)
    calls = [event["calls"] for event in nested]
    assert calls == sorted(calls)
    assert calls[-1] == run.calls
