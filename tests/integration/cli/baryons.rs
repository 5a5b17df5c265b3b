//! Disc and bulge by the settings: streams, mocks, fits, and fits with and without them side by side.

use super::{SMALL, example, json, oblate, refused, small_fit, write};
use std::path::Path;

const BARYONS: &str = "
[model.baryons]
disc = { profile = \"exponential\", thickness = 0.1 }
bulge = \"hernquist\"

[prior.marginals]
log10_m_disc = { kind = \"normal\", mean = 10.6, sd = 0.1 }
z0_kpc = { kind = \"normal\", mean = 0.0, sd = 150.0 }

[prior.fixed]
r_disc_kpc = 3.5
inclination_disc_deg = 70.0
phi_disc_deg = 20.0
log10_m_bulge = 10.0
r_bulge_kpc = 0.6
";

#[test]
fn a_stream_has_the_disc_of_the_settings() {
    let folder = tempfile::tempdir().expect("a folder");
    let config = write(folder.path(), "disc.toml", BARYONS);
    let halo_alone = std::fs::read_to_string(example("stream.toml")).expect("parameters");
    let with_disc = format!(
        "{halo_alone}log10_m_disc = 10.7\nr_disc_kpc = 3.5\ninclination_disc_deg = 70.0\nphi_disc_deg = 20.0\n\
         log10_m_bulge = 10.0\nr_bulge_kpc = 0.6\n"
    );
    let halo_alone = write(folder.path(), "halo.toml", &halo_alone);
    let with_disc = write(folder.path(), "with_disc.toml", &with_disc);
    let printed = |params: &str, more: &[&str]| {
        let output = oblate(&[&["stream", params], more].concat(), "");
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        String::from_utf8(output.stdout).expect("text")
    };
    let track = printed(&with_disc, &["--config", &config]);
    assert_ne!(track, printed(&halo_alone, &[]));
    // A profile changes the model's numbers, not its physics.
    let paper = printed(&with_disc, &["--config", &config, "--profile", "paper"]);
    assert_ne!(paper, printed(&halo_alone, &["--profile", "paper"]));

    // A disc whose parameters are not given, and parameters of a disc that the settings do not have.
    let output = oblate(&["stream", &halo_alone, "--config", &config], "");
    refused(&output, &["halo.toml", "log10_m_disc"]);
    let output = oblate(&["stream", &with_disc], "");
    refused(&output, &["with_disc.toml", "log10_m_disc"]);
    let lacking = BARYONS.replace("r_disc_kpc = 3.5\n", "");
    let lacking = write(folder.path(), "lacking.toml", &lacking);
    let output = oblate(&["stream", &halo_alone, "--config", &lacking], "");
    refused(&output, &["halo.toml", "r_disc_kpc"]);
    // The file has what the settings lack.
    assert_eq!(track, printed(&with_disc, &["--config", &lacking]));
}

#[test]
fn mocks_and_fits_have_a_disc_and_models_are_compared() {
    let (folder, _, _) = small_fit();
    let path = |name: &str| folder.path().join(name).display().to_string();
    // With a free shape vector, whose prior is isotropic.
    let small = SMALL.replace("dir_x = 0.1, dir_y = 0.2, ", "");
    let config = small
        .replace(
            "max_halvings = 3",
            "max_halvings = 3, baryons = { bulge = \"hernquist\", disc = { profile = \"miyamoto_nagai\", thickness = 0.1 } }",
        )
        .replace(
            "prior.fixed = {",
            "prior.marginals.log10_m_disc = { kind = \"uniform\", lo = 10.0, hi = 11.0 }\n\
             prior.fixed = { r_disc_kpc = 3.5, inclination_disc_deg = 70.0, phi_disc_deg = 20.0, log10_m_bulge = 10.0, r_bulge_kpc = 0.6,",
        );
    let config = write(folder.path(), "disc.toml", &config);
    let small = write(folder.path(), "free.toml", &small);
    let out = path("mocks");
    let mock = ["mock", "--config", &config, "--count", "1", "--seed", "4"];
    let output = oblate(
        &[&mock[..], &["--particles", "2000", "--out", &out]].concat(),
        "",
    );
    assert!(output.status.success(), "{output:?}");
    let listing = std::fs::read(Path::new(&out).join("mocks.json")).expect("a listing");
    let listing = json(&listing);
    let truth = &listing["mocks"][0]["truth"];
    assert!(truth["log10_m_disc"].as_f64().is_some_and(|m| m > 10.0));
    assert_eq!(truth["inclination_disc_deg"], 70.0);
    let name = listing["mocks"][0]["name"].as_str().expect("a name");
    let track = path(&format!("mocks/{name}.ecsv"));

    let fit = |name: &str, config: &str| {
        let out = path(name);
        let arguments = ["fit", &track, "--config", config, "--out", &out, "--json"];
        let output = oblate(&[&arguments[..], &["--allow-unconverged"]].concat(), "");
        assert!(output.status.success(), "{output:?}");
        (out, json(&output.stdout))
    };
    let (with, of_with) = fit("with", &config);
    let (without, of_without) = fit("without", &small);
    assert!(
        of_with["parameters"]["log10_m_disc"].is_object(),
        "{of_with}"
    );
    // The parameters differ by that of the disc.
    let output = oblate(&["compare", &with, &without], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("two models; ln Z") && text.contains("to 1 for"),
        "{text}"
    );
    let note = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(note.contains("nfw with a disc and a bulge"), "{note}");

    // The angle between the halo's axis and the disc of the one, and what the other lacks.
    let output = oblate(&["orientation", &with, "--to", "disc", "--json"], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = json(&output.stdout);
    let angle = said["streams"][0]["angle_deg"]["median"].as_f64();
    assert!(
        angle.is_some_and(|angle| (0.0..90.0).contains(&angle)),
        "{said}"
    );
    assert_eq!(said["alignments"][1]["alignment"], "aligned");
    let output = oblate(&["orientation", &without], "");
    let text = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(
        text.contains("isotropic") && text.contains("fraction aligned"),
        "{text}"
    );
    let note = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(
        note.contains("the fit without has not converged"),
        of_without["converged"] == false,
        "{note}"
    );
    let output = oblate(&["orientation", &without, "--to", "disc"], "");
    refused(&output, &["without", "model.baryons.disc"]);
    let output = oblate(&["orientation", &with, &without], "");
    refused(&output, &["the track is that of"]);
    // Odds are those against isotropic axes, which only that prior of the shape vector has. Two positive components leave the angle with the line of sight as it is, and
    // not that with the disc.
    let with_marginal = |run: &str, name: &str, marginal: &str| {
        let settings = Path::new(run).join("config.toml");
        let text = std::fs::read_to_string(&settings).expect("settings");
        let mut table: toml::Table = text.parse().expect("TOML");
        let marginal: toml::Table = marginal.parse().expect("TOML");
        table["prior"]["marginals"][name] = marginal.into();
        std::fs::write(&settings, table.to_string()).expect("a file");
    };
    with_marginal(&without, "dir_z", "kind = 'normal'\nmean = 0.0\nsd = 2.0");
    let output = oblate(&["orientation", &without], "");
    refused(&output, &["without", "not isotropic", "dir_z"]);
    with_marginal(&with, "dir_x", "kind = 'half_normal'\nsd = 1.0");
    let output = oblate(&["orientation", &with], "");
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let output = oblate(&["orientation", &with, "--to", "disc"], "");
    refused(&output, &["with", "not isotropic", "dir_x"]);

    // Its near side is known, so that the progenitor may be behind.
    let sides = BARYONS.replace("z0_kpc", "# z0_kpc");
    let sides = write(folder.path(), "sides.toml", &sides);
    let output = oblate(
        &["fit", &track, "--config", &sides, "--out", &path("x")],
        "",
    );
    refused(&output, &["prior.marginals.z0_kpc", "near side"]);
}
