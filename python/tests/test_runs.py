"""Fits in memory and in folders, and what other packages read of them."""

import numpy as np
import pytest
from conftest import TRACK

import oblate

# Two free parameters, few particles and few live points: a second.
QUICK = {
    "model.releases.particles": 128,
    "coarse_particles": 0,
    "sampling.sampler": "nested",
    "sampling.nested.n_live": 50,
    "sampling.nested.max_batches": 1,
    "sampling.nested.kernel": "random-slice",
    "sampling.nested.steps": 3,
} | {
    f"prior.fixed.{name}": value
    for name, value in {
        "r_s_halo_kpc": 15.0,
        "dir_x": 0.5,
        "dir_y": 0.2,
        "log10_m_prog": 7.7,
        "r_s_prog_kpc": 1.0,
        "x0_kpc": 60.0,
        "z0_kpc": 30.0,
        "vx0_km_s": 30.0,
        "vy0_km_s": 140.0,
        "vz0_km_s": 45.0,
        "age_gyr": 3.0,
    }.items()
}


@pytest.fixture(scope="module")
def quick():
    return oblate.Fit(TRACK, settings=QUICK)


@pytest.fixture(scope="module")
def folder(quick, tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "quick"
    quick.sample(out=folder)
    return folder


def test_a_fit_in_memory_is_that_of_the_folder_and_of_the_command(quick, folder, command, tmp_path):
    in_memory, read = quick.sample(), oblate.Run.read(folder)
    assert in_memory.theta.tobytes() == read.theta.tobytes()
    assert in_memory.ln_z == read.ln_z
    assert read.names == ["log10_m_halo", "dir_z"]
    assert read.units == ["dex(solMass)", ""]
    assert list(read.derived) == ["q", "axis_x", "axis_y", "axis_z", "log10_m200_halo"]
    assert np.array_equal(quick.derived(read.theta)["q"], read.derived["q"])
    assert np.array_equal(quick.ln_likelihood(read.theta), read.ln_likelihood)
    assert "68 % interval" in str(read)
    config = folder / "config.toml"
    of_command = tmp_path / "of_command"
    command("fit", TRACK, "--config", config, "--out", of_command, "--quiet", check=False)
    assert oblate.Run.read(of_command).theta.tobytes() == read.theta.tobytes()


def test_another_seed_gives_other_draws(quick):
    assert quick.sample(seed=2).seed == 2
    assert quick.sample(seed=2).theta.tobytes() != quick.sample().theta.tobytes()


def test_a_folder_that_exists_is_refused_resumed_or_replaced(quick, folder):
    with pytest.raises(oblate.OblateError, match="exists already"):
        quick.sample(out=folder)
    before = (folder / "summary.json").stat().st_mtime_ns
    resumed = quick.sample(out=folder, if_exists="resume")
    assert (folder / "summary.json").stat().st_mtime_ns == before
    replaced = quick.sample(out=folder, if_exists="replace")
    assert (folder / "summary.json").stat().st_mtime_ns != before
    assert resumed.theta.tobytes() == replaced.theta.tobytes()
    with pytest.raises(oblate.OblateError, match="if_exists = ask: give one of refuse, replace, resume"):
        quick.sample(out=folder, if_exists="ask")


def test_events_and_exceptions_of_a_fit(quick, tmp_path):
    events = []
    quick.sample(out=tmp_path / "told", on_event=events.append)
    stages = [event["name"] for event in events if event["event"] == "stage"]
    assert stages == ["check of the prior", "sampling", "error of the model"]

    def fails(event):
        raise RuntimeError("mine")

    for out in [None, tmp_path / "failed"]:
        with pytest.raises(RuntimeError, match="mine"):
            quick.sample(out=out, on_event=fails)


def test_draws_for_pandas(folder):
    run = oblate.Run.read(folder)
    draws = run.to_pandas()
    names = ["log10_m_halo", "dir_z", "q", "axis_x", "axis_y", "axis_z", "log10_m200_halo", "ln_likelihood"]
    assert list(draws) == names
    assert draws.attrs["units"]["log10_m_halo"] == "dex(solMass)"
    weighted = run.to_pandas(weighted=True)
    assert len(weighted) == len(run)
    assert weighted["weight"].sum() == pytest.approx(1.0)
    mean = (weighted["weight"] * weighted["q"]).sum()
    assert abs(draws["q"].mean() - mean) < 4.0 * weighted["q"].std() / np.sqrt(run.ess)


@pytest.mark.filterwarnings("default")  # of ArviZ and what it imports
def test_draws_for_xarray_and_arviz(folder, quick):
    tree = oblate.load(folder)
    assert {"posterior", "sample_stats", "observed_data", "prior", "weighted", "history"} <= set(tree.children)
    run = oblate.Run.read(folder)
    assert np.array_equal(tree["weighted"]["theta"].values, run.theta)
    assert np.array_equal(tree["posterior"]["q"].values.ravel(), run.to_pandas()["q"].to_numpy())
    theta = np.column_stack([tree["posterior"][name].values.ravel() for name in run.names])
    of_prior = (tree["sample_stats"]["lp"] - tree["sample_stats"]["ln_likelihood"]).values.ravel()
    assert np.allclose(of_prior, quick.ln_prior(theta), rtol=0.0, atol=1e-12 * abs(tree["sample_stats"]["lp"].values).max())
    data = oblate.load_arviz(folder)
    assert float(data.posterior["q"].mean()) == pytest.approx(float(tree["posterior"]["q"].mean()))


@pytest.mark.filterwarnings("default")  # of ArviZ and what it imports
def test_what_is_no_finished_run_is_refused(folder, tmp_path):
    for read in [oblate.Run.read, oblate.load, oblate.load_arviz]:
        with pytest.raises(FileNotFoundError, match="give a run folder"):
            read(tmp_path)
    damaged = tmp_path / "damaged"
    (damaged).mkdir()
    for name in ["config.toml", "summary.json"]:
        (damaged / name).write_bytes((folder / name).read_bytes())
    with pytest.raises(FileNotFoundError, match="posterior.zarr"):
        oblate.load(damaged)
