//! The pages of documentation agree with the code: links, names of parameters, settings, checks and benches.

use oblate::config::to_toml;
use oblate::data::ObservedTrack;
use oblate::inference::FitSettings;
use oblate::params::{PARAMETERS, Parameter, REQUIRED};
use std::path::{Path, PathBuf};

/// The pages.
pub const PAGES: [&str; 23] = [
    "README.md",
    "CHANGELOG.md",
    "docs/decisions.md",
    "docs/disc.md",
    "docs/faq.md",
    "docs/files.md",
    "docs/glossary.md",
    "docs/installation.md",
    "docs/limits.md",
    "docs/reliability.md",
    "docs/physics.md",
    "docs/python.md",
    "docs/samplers.md",
    "docs/targets.md",
    "docs/tour.md",
    "docs/tracks.md",
    "docs/validation.md",
    "benches/RESULTS.md",
    "benches/peers/README.md",
    "benches/studies/README.md",
    "python/README.md",
    "samplers/README.md",
    "tests/peers/README.md",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn text(page: &str) -> String {
    std::fs::read_to_string(root().join(page)).unwrap()
}

/// The parts of `text` between `open` and `close`.
fn between<'a>(text: &'a str, open: &'a str, close: char) -> impl Iterator<Item = &'a str> {
    text.split(open)
        .skip(1)
        .filter_map(move |rest| rest.split(close).next())
}

/// The anchor that a heading of a Markdown page has.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().to_lowercase();
    let kept = kept
        .chars()
        .filter(|c| c.is_alphanumeric() || " -_".contains(*c));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect()
}

#[test]
fn links_lead_to_files_and_headings() {
    for page in PAGES {
        let folder = root().join(page).parent().unwrap().to_path_buf();
        for link in between(&text(page), "](", ')').filter(|link| !link.contains("://")) {
            let (file, heading) = link.split_once('#').unwrap_or((link, ""));
            let file: PathBuf = if file.is_empty() {
                root().join(page)
            } else {
                folder.join(file)
            };
            assert!(file.exists(), "{page}: {link}");
            if !heading.is_empty() {
                let text = std::fs::read_to_string(file).unwrap();
                let mut headings = text.lines().filter(|line| line.starts_with('#'));
                let found = headings.any(|line| anchor(line.trim_start_matches('#')) == heading);
                assert!(found, "{page}: {link}");
            }
        }
    }
}

#[test]
fn the_readme_has_at_most_a_thousand_words_and_every_parameter() {
    let readme = text("README.md");
    assert!(readme.split_whitespace().count() <= 1_000);
    for Parameter { name, .. } in &PARAMETERS[..REQUIRED] {
        assert!(readme.contains(&format!("`{name}`")), "{name}");
    }
}

#[test]
fn every_setting_is_explained() {
    let pages = ["docs/physics.md", "docs/samplers.md", "docs/files.md"]
        .map(text)
        .concat();
    let settings = to_toml(&FitSettings::default()).unwrap();
    let keys = settings.lines().filter_map(|line| line.split_once(" = "));
    for (key, _) in keys {
        // As a whole word: `steps` is not explained by `orbit_steps`.
        let mut words = pages.split(|c: char| !(c.is_alphanumeric() || c == '_'));
        assert!(words.any(|word| word == key), "{key}");
    }
}

#[test]
fn the_tracks_on_the_pages_can_be_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("track.csv");
    let mut count = 0;
    for page in ["docs/tracks.md", "docs/files.md"] {
        for block in text(page)
            .split("```\n")
            .skip(1)
            .filter(|b| b.starts_with("# "))
        {
            std::fs::write(&path, block).unwrap();
            ObservedTrack::read(&path).unwrap_or_else(|e| panic!("{page}: {e}"));
            count += 1;
        }
    }
    assert_eq!(count, 3);
}

/// The command lines of `oblate` in the blocks of a page, without comments, continued lines joined.
pub fn command_lines(page: &str) -> Vec<String> {
    let text = text(page).replace("\\\n", " ");
    let blocks = text.split("```").skip(1).step_by(2);
    let lines = blocks
        .filter_map(|block| block.strip_prefix("sh\n"))
        .flat_map(str::lines);
    lines
        .filter_map(|line| {
            let line = line.split(" #").next()?.split(" > ").next()?.trim();
            let line = line.replace("cargo run --release -- ", "oblate ");
            line.starts_with("oblate ").then_some(line)
        })
        .collect()
}

#[test]
fn every_command_line_on_a_page_is_one() {
    let mut count = 0;
    for page in PAGES {
        for line in command_lines(page) {
            let words = line.split_whitespace();
            let parsed = oblate::cli::command().try_get_matches_from(words);
            if let Err(error) = parsed {
                panic!("{page}: {line}: {error}");
            }
            count += 1;
        }
    }
    assert!(count >= 12, "only {count} command lines found");
}

#[test]
fn every_flag_on_a_page_is_one_of_its_subcommand() {
    let mut command = oblate::cli::command();
    command.build();
    let mut count = 0;
    for page in PAGES {
        for span in between(&text(page), "`oblate ", '`') {
            let name = span.split_whitespace().next().unwrap();
            let Some(verb) = command.find_subcommand(name) else {
                continue;
            };
            for word in span
                .split_whitespace()
                .filter(|word| word.starts_with("--"))
            {
                let flag = word[2..].split('=').next().unwrap();
                let known = verb.get_arguments().any(|a| a.get_long() == Some(flag));
                assert!(known, "{page}: oblate {span}");
                count += 1;
            }
        }
    }
    assert!(count > 12, "only {count} flags found");
}

#[test]
fn every_check_is_explained() {
    let page = text("docs/samplers.md");
    let files = [
        "nested/checks.rs",
        "nested/merge.rs",
        "pt/checks.rs",
        "bridge/outcome.rs",
        "../../src/population/predictive.rs",
        "../../src/population/reweighting.rs",
        "../../src/population/selection.rs",
    ];
    let constants = [
        "nested/check_names.rs",
        "pt/check_names.rs",
        "bridge/outcome.rs",
        "output.rs",
    ];
    let source = |file: &str| text(&format!("samplers/src/{file}"));
    let constants = constants.map(source).concat();
    let mut count = 0;
    for file in files {
        let source = source(file);
        let names = |call| {
            source.split(call).skip(1).map(|arguments| {
                let name = arguments.trim_start().split(',').next().unwrap();
                let literal = if name.starts_with('"') {
                    name
                } else {
                    let constant = name.rsplit("::").next().unwrap();
                    let definition = format!(" {constant}: &str = ");
                    constants.split(&definition).nth(1).expect(name)
                };
                literal.split('"').nth(1).unwrap().to_owned()
            })
        };
        for name in names("Check::at_most(").chain(names("Check::at_least(")) {
            assert!(page.contains(&format!("| `{name}` |")), "{file}: {name}");
            count += 1;
        }
    }
    assert!(count > 20, "only {count} checks found");
}

#[test]
fn benches_that_pages_name_exist() {
    let manifest = text("Cargo.toml") + &text("samplers/Cargo.toml");
    for page in PAGES {
        for name in between(&text(page), "--bench ", '`') {
            let name = name.split_whitespace().next().unwrap();
            assert!(
                manifest.contains(&format!("name = \"{name}\"")),
                "{page}: {name}"
            );
        }
    }
}
