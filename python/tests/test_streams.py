"""Tracks and particles: those of the command, and tracks made of arrays."""

import csv
import json

import numpy as np
import pytest
from conftest import TRACK

import oblate


@pytest.fixture
def parameters(fit, points):
    return dict(zip(fit.names, points[0].tolist()))


@pytest.fixture
def parameter_file(parameters, tmp_path):
    path = tmp_path / "parameters.toml"
    path.write_text("".join(f"{name} = {value!r}\n" for name, value in parameters.items()))
    return path


def test_a_track_is_that_of_the_command(parameters, parameter_file, command):
    answer = json.loads(command("stream", parameter_file, "--json", "--bin-width", 5))["track"]
    track = oblate.Model().track(parameters, bin_width_deg=5.0)
    assert {name: column.tolist() for name, column in track.items()} == answer


def test_what_is_free_is_given_and_what_is_fixed_may_be_left_out(parameters):
    friction = {
        "model.dynamical_friction": True,
        "prior.marginals.coulomb_logarithm": {"kind": "uniform", "lo": 0.0, "hi": 5.0},
    }
    with pytest.raises(ValueError, match="coulomb_logarithm = missing"):
        oblate.Model(settings=friction).stream(parameters)
    farther = oblate.Model(settings={"prior.fixed.distance_factor": 2.0})
    given = farther.track({**parameters, "distance_factor": 2.0})
    assert farther.track(parameters)["r_kpc"].tolist() == given["r_kpc"].tolist()


def test_particles_are_those_of_the_command(parameters, parameter_file, command, tmp_path):
    table = tmp_path / "particles.csv"
    command("stream", parameter_file, "--particles-out", table)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    particles = oblate.Model().stream(parameters)
    assert list(particles) == list(rows[0])
    assert particles["tail"].tolist() == [row["tail"] for row in rows]
    for name in list(particles)[1:]:
        assert particles[name].tolist() == [float(row[name]) for row in rows]


def test_the_stream_of_a_fit_is_that_of_its_model(fit, points, parameters):
    of_fit, of_model = fit.stream(points[0]), oblate.Model().stream(parameters)
    for name, column in of_model.items():
        assert (of_fit[name] == column).all()
    of_fit, of_model = fit.track(points[0]), oblate.Model().track(parameters)
    common = np.isin(of_fit["phi_deg"], of_model["phi_deg"])
    assert common.sum() > 10
    assert of_fit["r_kpc"][common].tolist() == of_model["r_kpc"].tolist()


def test_points_without_a_stream_are_errors_with_a_remedy(fit, points, parameters):
    with pytest.raises(oblate.OblateError, match="outside_prior; give parameters inside the prior"):
        fit.track(-points[0])
    with pytest.raises(oblate.OblateError, match="give one point"):
        fit.stream(points)
    with pytest.raises(oblate.OblateError, match="age_gyr = 9 lies outside its prior"):
        oblate.Model().track({**parameters, "age_gyr": 9.0})
    with pytest.raises(oblate.OblateError, match="there is no such parameter"):
        oblate.Model().track({**parameters, "age": 3.0})
    del parameters["age_gyr"]
    with pytest.raises(oblate.OblateError, match="age_gyr = missing"):
        oblate.Model().stream(parameters)


def test_the_track_is_that_of_data_with_parameters_of_the_observation(parameters):
    phi0 = {"kind": "uniform", "lo": -40.0, "hi": 40.0}
    observed = oblate.Model(settings={"prior.marginals.phi0_deg": phi0, "prior.fixed.distance_factor": 2.0})
    plain, moved = oblate.Model().track(parameters), observed.track({**parameters, "phi0_deg": 20.0, "distance_factor": 2.0})
    assert moved["phi_deg"] == pytest.approx(plain["phi_deg"] + 20.0)
    assert moved["r_kpc"] == pytest.approx(plain["r_kpc"] / 2.0)
    with pytest.raises(oblate.OblateError, match="absent"):
        oblate.Model().track({**parameters, "phi0_deg": 20.0})


def test_a_track_of_arrays_is_that_of_the_file(fit, points):
    read = oblate.Track.read(TRACK)
    assert len(read) == 12
    assert read.assumptions == []
    assert (read.r_err_lo_kpc == read.r_err_hi_kpc).all()
    made = oblate.Track(read.phi_deg, read.r_kpc, read.r_err_lo_kpc, bin_width_deg=read.bin_width_deg, name="made")
    assert oblate.Fit(made).ln_likelihood(points).tolist() == fit.ln_likelihood(points).tolist()
    assert oblate.Fit(made).data.name == "made"


def test_a_track_of_arrays_has_velocities_widths_and_densities():
    nan = float("nan")
    measured = {"v_km_s": [-50.0, nan, 20.0], "v_err_km_s": [5.0, nan, 4.0]}
    columns = [[-10.0, 0.0, 10.0], [50.0, 51.0, 52.0], [1.0, 1.0, 1.0]]
    track = oblate.Track(*columns, bin_width_deg=10.0, **measured)
    assert track.v_km_s == pytest.approx(measured["v_km_s"], nan_ok=True)
    assert track.v_err_km_s == pytest.approx(measured["v_err_km_s"], nan_ok=True)
    assert track.width_kpc is None and track.density_err_per_deg is None
    others = {"width_kpc": [1.0] * 3, "width_err_kpc": [0.1] * 3, "density_per_deg": [9.0] * 3, "density_err_per_deg": [2.0] * 3}
    track = oblate.Track(*columns, bin_width_deg=10.0, **others)
    assert track.width_kpc.tolist() == [1.0] * 3 and track.width_err_kpc.tolist() == [0.1] * 3
    assert track.density_per_deg.tolist() == [9.0] * 3 and track.density_err_per_deg.tolist() == [2.0] * 3
    with pytest.raises(ValueError, match="together"):
        oblate.Track(*columns, bin_width_deg=10.0, v_km_s=[1.0, 2.0, 3.0])
    with pytest.raises(oblate.OblateError, match="bin 2"):
        oblate.Track(*columns, bin_width_deg=10.0, v_km_s=[1.0, 2.0, 3.0], v_err_km_s=[1.0, 0.0, 1.0])
    with pytest.raises(oblate.OblateError, match="empty"):
        oblate.Track(*columns, bin_width_deg=10.0, width_kpc=[nan] * 3, width_err_kpc=[nan] * 3)


def test_tracks_that_cannot_be_used_are_refused(tmp_path):
    with pytest.raises(FileNotFoundError, match="give the path of a readable ECSV or CSV track"):
        oblate.Fit(tmp_path / "none.csv")
    with pytest.raises(oblate.OblateError, match="bin 2"):
        oblate.Track([0.0, 10.0, 20.0], [50.0, -1.0, 50.0], [1.0, 1.0, 1.0], bin_width_deg=10.0)
    bare = tmp_path / "bare.csv"
    bare.write_text("phi,r\n" + "".join(f"{phi},60\n" for phi in range(-25, 35, 10)))
    with pytest.raises(oblate.OblateError, match="error"):
        oblate.Track.read(bare)
    assumed = oblate.Track.read(bare, assume_error="2%")
    assert assumed.r_err_hi_kpc.tolist() == [1.2] * 6
    assert "2%" in assumed.assumptions[0]
    with pytest.raises(oblate.OblateError, match="handedness = left"):
        oblate.Track.read(bare, assume_error="2%", handedness="left")
