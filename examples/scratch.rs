//! Scratch.
use oblate::config::{FitConfig, read};
use oblate::run::{RunFolder, target};
use oblate_samplers::*;
use std::path::Path;

struct Tempered<'a> {
    of: &'a dyn Target,
    beta: f64,
}
impl Target for Tempered<'_> {
    fn prior(&self) -> &Prior {
        self.of.prior()
    }
    fn ln_likelihood(&self, t: &[f64]) -> Outcome {
        match self.of.ln_likelihood(t) {
            Outcome::Value(l) => Outcome::Value(self.beta * l),
            o => o,
        }
    }
}
fn main() {
    let a: Vec<String> = std::env::args().collect();
    let folder = RunFolder::open(Path::new(&a[1])).unwrap();
    let stored = folder.read().unwrap();
    let track = folder.read_track().unwrap();
    let config: FitConfig = read(&folder.config()).unwrap();
    let whole = target(&track, &config).unwrap();
    for beta in [1e-3, 1e-2, 0.03, 0.1, 0.2, 0.4, 0.7, 1.0] {
        let of = Tempered { of: &whole, beta };
        let mut run = stored.run.clone();
        for (w, l) in run
            .draws
            .ln_weight
            .iter_mut()
            .zip(&mut run.draws.ln_likelihood)
        {
            *w += (beta - 1.0) * *l;
            *l *= beta;
        }
        let sum = diagnostics::ln_sum_exp(&run.draws.ln_weight);
        run.draws.ln_weight.iter_mut().for_each(|w| *w -= sum);
        let kish = diagnostics::kish_ess(&run.draws.ln_weight);
        let mean: f64 = run
            .draws
            .weights()
            .iter()
            .zip(&run.draws.ln_likelihood)
            .map(|(w, l)| w * l / beta)
            .sum();
        for components in [1, 8, 64] {
            let settings = boost::Settings {
                draws: 10_000,
                max_components: components,
                ..boost::Settings::default()
            };
            match boost::run(
                &of,
                &run,
                &settings,
                1,
                &mut Control::new(&mut control::Silent),
            ) {
                Ok(b) => println!(
                    "beta {beta} <l> {mean:.0} kish {kish:.0} components {components}: calls per draw {:.0}, k {:.2}",
                    b.cost.calls as f64 / b.ess.kish,
                    b.gates[0].value
                ),
                Err(e) => println!("beta {beta} kish {kish:.0}: {e}"),
            }
        }
    }
}
