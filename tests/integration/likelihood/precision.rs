//! Single precision against double.

use super::*;
use oblate::data::ObservedTrack;
use oblate::inference::{FitSettings, StreamTarget};
use std::path::Path;

/// The draws of benches/draws.csv, each with the likelihood that a fit to its track begins with.
fn coarse_models_and_draws() -> Vec<(StreamLikelihood, Theta)> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut reader = csv::ReaderBuilder::new()
        .comment(Some(b'#'))
        .from_path(folder.join("benches/draws.csv"))
        .expect("the draws");
    let rows = reader.deserialize::<(String, [f64; REQUIRED])>();
    rows.map(|row| {
        let (name, theta) = row.expect("a name and 13 numbers");
        let file = folder.join(format!("examples/tracks/{name}.ecsv"));
        let track = ObservedTrack::read(&file).expect("a gala track");
        let coarse = FitSettings::default().coarse(track.bin_width_deg);
        let mut coarse = coarse.expect("a coarse model");
        coarse.model.precision = Precision::Single;
        let target = StreamTarget::from_track(&track, &coarse).expect("a target");
        (target.likelihood().clone(), without_optional(theta))
    })
    .collect()
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    values[values.len() / 2]
}

#[test]
fn values_and_gradients_in_single_precision_are_those_in_double_with_the_same_steps() {
    let norm = |v: &Theta| v.iter().map(|g| g * g).sum::<f64>().sqrt();
    let differences: Vec<(f64, f64)> = coarse_models_and_draws()
        .into_par_iter()
        .map(|(likelihood, theta)| {
            let (evaluation, ours) = likelihood.gradient(&theta).expect("a gradient");
            let (value, exact) = gradient_by_duals(&likelihood, &theta).expect("a gradient");
            let difference: Theta = std::array::from_fn(|i| ours[i] - exact[i]);
            (
                (evaluation.ln_likelihood - value).abs(),
                norm(&difference) / norm(&exact),
            )
        })
        .collect();
    // Positions are rounded to 1e-7 some hundred times, which the flow of a stream amplifies a hundredfold: 1e-4 of the radius, where
    // bins have errors of 2e-2.
    let (values, gradients): (Vec<f64>, Vec<f64>) = differences.into_iter().unzip();
    let largest = values.iter().copied().fold(0.0, f64::max);
    let median = [values, gradients].map(median);
    assert!(largest < 0.01 && median[0] < 1e-3, "{largest:e} {median:?}");
    // The exact derivative of a chaotic particle is no smaller than its amplified rounding, so that single draws may differ.
    assert!(median[1] < 2e-3, "{median:?}");
}

#[test]
fn equal_steps_in_single_precision_are_those_in_double() {
    let likelihood = likelihood_at(&BASE, &model(small()), &LikelihoodSettings::default());
    let likelihood = likelihood.expect("a likelihood");
    let values = [Precision::Double, Precision::Single].map(|precision| {
        let settings = ModelSettings {
            precision,
            ..small()
        };
        let likelihood = likelihood.with_model(model(settings));
        let (value, gradient) = likelihood.gradient(&BASE).expect("a gradient");
        (value.ln_likelihood, gradient)
    });
    let [(double, double_gradient), (single, single_gradient)] = values;
    assert!((double - single).abs() < 0.01, "{double} {single}");
    for (a, b) in double_gradient.iter().zip(single_gradient) {
        assert!((a - b).abs() < 1e-3 * a.abs().max(1.0), "{a} {b}");
    }
}
