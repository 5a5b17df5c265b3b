//! What the command says about the machine it is on.

use super::{json, oblate, refused};
use oblate::posterior::SUMMARY_FORMAT;
use oblate::scalar::Level;
use oblate_samplers::checkpoint::FORMAT_VERSION;
use oblate_samplers::rng::STREAM_VERSION;

#[test]
fn the_machine_is_described_and_measured() {
    let output = oblate(
        &["doctor", "--seconds", "1", "--threads", "1", "--json", "-q"],
        "",
    );
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let found = json(&output.stdout);
    assert_eq!(found["threads"], 1);
    assert_eq!(found["version"], env!("CARGO_PKG_VERSION"));
    let name = match Level::best() {
        Level::Avx512 => &["AVX-512"][..],
        Level::Avx2 => &["AVX2"],
        Level::Baseline => &["SSE2", "NEON", "portable"],
    };
    assert!(name.contains(&found["instruction_set"].as_str().expect("a name")));
    let speed = &found["values_per_second"];
    let (model, coarse) = (
        speed["model"].as_f64().expect("a number"),
        speed["coarse"].as_f64().expect("a number"),
    );
    // A fifth of the particles in steps of twice the length: several times as fast.
    assert!(coarse > 2.0 * model && model > 1.0, "{coarse} {model}");
    let times: Vec<f64> = serde_json::from_value(found["seconds_of_fit"].clone()).expect("times");
    assert!(times[0] > 0.0 && times.is_sorted(), "{times:?}");
    assert_eq!(times.len(), 3);
    refused(&oblate(&["doctor", "--seconds", "0"], ""), &["--seconds"]);
}

#[test]
fn the_pages_have_the_present_versions() {
    let versions = format!(
        "random streams {STREAM_VERSION}, checkpoints {FORMAT_VERSION}, summaries {SUMMARY_FORMAT}"
    );
    for page in ["docs/installation.md", "CHANGELOG.md"] {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(page);
        let text = std::fs::read_to_string(path).expect("the page");
        assert!(text.contains(&versions), "{page}: {versions}");
    }
}
