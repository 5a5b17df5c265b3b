//! Velocities, widths and densities by the command: mocks, fits, pages, and what is refused.

use super::{SMALL, json, oblate, refused, small_fit, write};
use oblate::inference::StreamTarget;
use oblate::run::RunFolder;
use oblate::track::BinQuantity;
use std::path::Path;

const BOTH_SIDES: &str = "prior.marginals.z0_kpc={kind=\"normal\",mean=0,sd=150}";
const STARS: &str = "prior.marginals.log10_n_stars={kind=\"uniform\",lo=2,hi=4}";
const HOST: &str = "prior.marginals.v_host_km_s={kind=\"normal\",mean=0,sd=5}";

/// The cells of a track's table.
fn rows(text: &str) -> Vec<Vec<String>> {
    let rows = text.lines().filter(|line| !line.starts_with('#')).skip(1);
    rows.map(|row| row.split(',').map(str::to_owned).collect())
        .collect()
}

#[test]
fn mocks_and_fits_have_velocities_widths_and_densities() {
    let (folder, config, _) = small_fit();
    let path = |name: &str| folder.path().join(name).display().to_string();
    let mock = |config: &str, more: &[&str]| {
        let mock = ["mock", "--config", config, "--seed", "4"];
        oblate(&[&mock[..], &["--particles", "2000"], more].concat(), "")
    };
    let (plain, out) = (path("plain"), path("mocks"));
    let output = mock(&config, &["--out", &plain]);
    assert!(output.status.success(), "{output:?}");
    let noise = ["--velocity-noise", "5", "--width-noise", "0.1"];
    let noise = [&noise[..], &["--density-noise", "0.1", "--out", &out]].concat();
    let noise = [&noise[..], &["--stars", "30,5"]].concat();
    refused(&mock(&config, &noise), &["density_noise", "log10_n_stars"]);
    // A sample of a thousand stars.
    let text = SMALL.replace("prior.fixed = {", "prior.fixed = { log10_n_stars = 3.0, ");
    let output = mock(&write(folder.path(), "stars.toml", &text), &noise);
    assert!(output.status.success(), "{output:?}");
    let listing = std::fs::read(Path::new(&out).join("mocks.json")).expect("a listing");
    let listing = json(&listing);
    assert_eq!(listing["settings"]["velocity_noise_km_s"], 5.0);
    let name = listing["mocks"][0]["name"].as_str().expect("a name");
    let read = |folder: &str| {
        let file = Path::new(folder).join(format!("{name}.ecsv"));
        let text = std::fs::read_to_string(&file).expect("a track");
        (rows(&text), file.display().to_string())
    };
    let (bare, _) = read(&plain);
    let (measured, track) = read(&out);
    // Stars follow the bins.
    assert_eq!(measured.len(), bare.len() + 30);
    for (row, bare) in measured.iter().zip(&bare) {
        // The radii are those of the mock without other data.
        assert_eq!((row.len(), &row[..4]), (10, &bare[..]));
        let number = |k: usize| row[k].parse::<f64>().expect("a number");
        assert!(number(5) >= 5.0);
        // Half as many stars as particles, in bins of 10 degrees: within five errors.
        let expected = 0.5 * number(3) / 10.0;
        assert!((number(8) - expected).abs() < 5.0 * number(9), "{row:?}");
    }

    // A progenitor whose side is not known.
    let settings = SMALL.replace("z0_kpc = 30.0, ", "");
    let config = write(folder.path(), "free.toml", &settings);
    // Nothing but the velocities tells it.
    let even = settings
        .replace("dir_x = 0.1, dir_y = 0.2, ", "")
        .replace(", vz0_km_s = 45.0", "");
    let even = write(folder.path(), "even.toml", &even);
    let run = path("run");
    let fit_with = |config: &str, sets: &[&str]| {
        let mut arguments = vec!["fit", &track, "--config", config, "--out", &run];
        arguments.extend(["-q", "--allow-unconverged", "--json"]);
        arguments.extend(sets.iter().flat_map(|set| ["--set", *set]));
        oblate(&arguments, "")
    };
    let fit = |sets: &[&str]| fit_with(&config, sets);
    refused(&fit(&[BOTH_SIDES]), &["log10_n_stars", "lo = 2"]);
    refused(&fit(&[STARS]), &["z0_kpc", "dir_x"]);
    refused(&fit_with(&even, &[STARS]), &["z0_kpc", "velocities"]);
    let output = fit(&[BOTH_SIDES, STARS, HOST]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let summary = json(&output.stdout);
    for name in ["v_host_km_s", "log10_n_stars"] {
        assert!(summary["parameters"].to_string().contains(name));
    }
    let diagnostics = &summary["diagnostics"];
    // By hand, from the model's track at the draw of largest likelihood.
    let stored = RunFolder::open(Path::new(&run)).expect("a folder");
    let observed = stored.read_track().expect("a track");
    let run_read = stored.read().expect("a run");
    let settings = run_read.fit_settings(&stored).expect("settings");
    let target = StreamTarget::from_track(&observed, &settings.expect("a fit")).expect("a target");
    let draws = &run_read.run.draws;
    let best = (0..draws.len())
        .max_by(|a, b| draws.ln_likelihood[*a].total_cmp(&draws.ln_likelihood[*b]))
        .expect("draws");
    let params = target.params(draws.theta_row(best));
    let (model, _) = target.likelihood().track_at(&params).expect("a stream");
    for (quantity, chi2, count) in [
        (
            BinQuantity::Velocity,
            "best_fit_chi2_velocity",
            "best_fit_velocities",
        ),
        (BinQuantity::Width, "best_fit_chi2_width", "best_fit_widths"),
        (
            BinQuantity::Density,
            "best_fit_chi2_density",
            "best_fit_densities",
        ),
    ] {
        let rows = observed.phi_deg.iter().zip(&observed.measured[&quantity]);
        let squares = rows.filter_map(|(phi, datum)| {
            let mut bins = model.bins.iter();
            let bin = bins.find(|bin| (bin.phi_deg - phi).abs() < 1e-6)?;
            let datum = datum.expect("a datum in every bin");
            Some(((datum.value - bin.value(quantity)) / datum.error).powi(2))
        });
        let expected: f64 = squares.sum();
        let stated = diagnostics[chi2].as_f64().expect("a number");
        assert!(
            (stated - expected).abs() < 1e-9 * expected,
            "{chi2}: {stated} {expected}"
        );
        assert_eq!(diagnostics[count], diagnostics["best_fit_bins"]);
    }
    assert_eq!(diagnostics["best_fit_star_velocities"], 30.0);
    let page = path("page.html");
    let output = oblate(&["report", &run, "--out", &page], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = std::fs::read_to_string(&page).expect("the page");
    assert!(text.contains("line-of-sight velocity") && !text.contains("NaN"));
    for figure in ["velocities.svg", "widths.svg", "densities.svg"] {
        assert!(Path::new(&run).join(figure).exists(), "{figure}");
    }
    // The figures are those of a run, and are removed with it. A foreign file is refused before anything is removed.
    let notes = Path::new(&run).join("notes.txt");
    std::fs::write(&notes, "mine").expect("a file");
    let arguments = ["fit", &track, "--config", &config, "--out", &run, "--force"];
    let sets = [BOTH_SIDES, STARS, HOST].map(|set| ["--set", set]).concat();
    let output = oblate(&[&arguments[..], &sets].concat(), "");
    refused(&output, &["`notes.txt`"]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    for figure in ["velocities.svg", "widths.svg", "densities.svg"] {
        assert!(!message.contains(figure), "{message}");
    }
}

#[test]
fn parameters_of_data_are_refused_without_these() {
    let (folder, config, track) = small_fit();
    let out = folder.path().join("run").display().to_string();
    for (set, words) in [
        (HOST, ["v_host_km_s", "`v`"]),
        (STARS, ["log10_n_stars", "`density`"]),
    ] {
        let fit = ["fit", &track, "--config", &config, "--set", set];
        refused(&oblate(&[&fit[..], &["--out", &out]].concat(), ""), &words);
    }
}

#[test]
fn a_half_measured_row_is_refused_with_its_line() {
    let (folder, config, _) = small_fit();
    let text = "phi,r,r_err,v,v_err\n-15,60,1,3,1\n-5,61,1,4,\n5,62,1,5,1\n";
    let track = write(folder.path(), "half.csv", text);
    let out = folder.path().join("run").display().to_string();
    let output = oblate(&["fit", &track, "--config", &config, "--out", &out], "");
    refused(&output, &["half.csv", "line 3", "`v_err`"]);
}
