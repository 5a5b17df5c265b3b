//! The tour of docs/tour.md, typed as a new user types it: the page shows what the commands print.

#![cfg(unix)]

use std::path::Path;
use std::process::Command;

/// Lines of the page that stand for any number of lines.
const LEFT_OUT: &str = "...";

/// The blocks of commands of the page, each with the lines that it shows of their output.
fn steps(page: &str) -> Vec<(&str, Vec<&str>)> {
    let mut steps: Vec<(&str, Vec<&str>)> = Vec::new();
    for block in page.split("```").skip(1).step_by(2) {
        if let Some(commands) = block.strip_prefix("sh\n") {
            steps.push((commands, Vec::new()));
        } else if let (Some(shown), Some(step)) = (block.strip_prefix("text\n"), steps.last_mut()) {
            step.1 = shown.lines().collect();
        }
    }
    steps
}

/// A line with `#` in place of every number, and one space between words: times are never the same, and the last digits depend on the
/// instruction set.
fn without_numbers(line: &str) -> String {
    let word = |word: &str| {
        let mut masked = String::new();
        let mut rest = word;
        while let Some(c) = rest.chars().next() {
            let is_number = |c: char| c.is_ascii_digit() || "+-.e".contains(c);
            let signed = rest.trim_start_matches(['+', '-']);
            let end = rest.len() - signed.trim_start_matches(is_number).len();
            if signed.starts_with(|c: char| c.is_ascii_digit()) {
                masked.push('#');
                rest = &rest[end..];
            } else {
                masked.push(c);
                rest = &rest[c.len_utf8()..];
            }
        }
        masked
    };
    let words: Vec<String> = line.split_whitespace().map(word).collect();
    words.join(" ")
}

/// The first shown line that the output does not have in its place; all lines of the output must be shown or left out.
fn first_missing<'a>(shown: &[&'a str], output: &str) -> Option<&'a str> {
    let mut lines = output.lines().map(without_numbers).peekable();
    let mut any = false;
    for line in shown {
        if line.trim() == LEFT_OUT {
            any = true;
            continue;
        }
        let wanted = without_numbers(line);
        while any && lines.next_if(|found| *found != wanted).is_some() {}
        if lines.next() != Some(wanted) {
            return Some(line);
        }
        any = false;
    }
    (!any && lines.peek().is_some()).then_some("the end of the output")
}

/// The first two numbers of a text, whatever is between them.
fn two_numbers(text: &str) -> Option<[f64; 2]> {
    let is_number = |c: char| c.is_ascii_digit() || "+-.e".contains(c);
    let mut numbers = text
        .split(|c| !is_number(c))
        .filter_map(|word| word.parse().ok());
    Some([numbers.next()?, numbers.next()?])
}

/// Name, median and 68 % interval of a row of a table of parameters.
fn parameter_row(line: &str) -> Option<(&str, f64, [f64; 2])> {
    let (head, interval) = line.split_once('[')?;
    let mut words = head.split_whitespace();
    let (name, median) = (words.next()?, words.next()?.parse().ok()?);
    Some((name, median, two_numbers(interval)?))
}

/// The first word of a line, and the first number with an error in it: ln Z, in the lines of the page.
fn with_error(line: &str) -> Option<(&str, f64, f64)> {
    let (before, after) = line.split_once(" +- ")?;
    let (value, error) = (
        before.split_whitespace().last()?,
        after.split_whitespace().next()?,
    );
    Some((
        before.split_whitespace().next()?,
        value.parse().ok()?,
        error.parse().ok()?,
    ))
}

/// Compares the numbers of both that do not depend on the time that a command took: medians, to half of the half-width of the interval shown,
/// many times what other draws would move them by, and ln Z, to three of both errors, unless the fit has not converged: its errors say little. The
/// number of comparisons, or what differs.
fn numbers_agree(shown: &[&str], output: &str) -> Result<usize, String> {
    let mut count = 0;
    for line in shown {
        if let Some((name, median, [lo, hi])) = parameter_row(line) {
            let found = output.lines().filter_map(parameter_row);
            let ours = found.filter(|row| row.0 == name).map(|row| row.1).next();
            count += 1;
            if ours.is_none_or(|ours| (ours - median).abs() > 0.25 * (hi - lo)) {
                return Err(format!("{name}: {ours:?} for {median}"));
            }
        } else if let Some((word, value, error)) = with_error(line)
            && !line.contains(" NO ")
        {
            let mut found = output.lines().filter_map(with_error);
            let ours = found.find(|row| row.0 == word);
            count += 1;
            if ours.is_none_or(|ours| (ours.1 - value).abs() > 3.0 * error.hypot(ours.2)) {
                return Err(format!("{word}: {ours:?} for {value} +- {error}"));
            }
        }
    }
    Ok(count)
}

#[test]
fn the_tour_prints_what_its_page_shows() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let folder = tempfile::tempdir().expect("a folder");
    std::os::unix::fs::symlink(root.join("examples"), folder.path().join("examples"))
        .expect("a link");
    let command = Path::new(env!("CARGO_BIN_EXE_oblate"))
        .parent()
        .expect("a folder");
    let path = std::env::var("PATH").expect("a path");
    let page = std::fs::read_to_string(root.join("docs/tour.md")).expect("the page");
    let steps = steps(&page);
    assert_eq!(steps.len(), 5);
    let mut count = 0;
    for (commands, shown) in steps {
        assert!(!shown.is_empty(), "{commands}");
        let output = Command::new("sh")
            .args(["-c", &format!("exec 2>&1\n{commands}")])
            .env("PATH", format!("{}:{path}", command.display()))
            .env("LC_ALL", "C")
            .current_dir(folder.path())
            .output()
            .expect("a shell");
        let output = String::from_utf8_lossy(&output.stdout);
        if let Some(line) = first_missing(&shown, &output) {
            panic!("{commands}\ndoes not print\n{line}\nbut\n{output}");
        }
        count += numbers_agree(&shown, &output)
            .unwrap_or_else(|found| panic!("{commands}\nprints another number\n{found}"));
    }
    // Seven parameters and ln Z of one track.
    assert_eq!(count, 8);
}

#[test]
fn a_number_that_is_another_one_is_found() {
    let output = "ln Z = -24.7 +- 0.1\n mass 12.00 [11.9, 12.1] [11.8, 12.2] dex\n";
    let agree = |shown: &str| numbers_agree(&[shown], output);
    assert_eq!(agree("in runs/s2, 3 seconds"), Ok(0));
    for (right, wrong) in [
        ("ln Z = -24.3 +- 0.1", "ln Z = -24.2 +- 0.1"),
        (
            "mass 12.04 [11.9, 12.1] [9, 15] dex",
            "mass 12.06 [11.9, 12.1] [9, 15] dex",
        ),
        ("mass 12.00 [11.9, 12.1]", "q 12.00 [11.9, 12.1]"),
    ] {
        assert_eq!(agree(right), Ok(1));
        assert!(agree(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn a_line_that_is_not_printed_is_found() {
    let output = "one 1.5e-3\ntwo [-2, 3]\nthree\n";
    let missing = |shown: &[&str]| first_missing(shown, output).is_some();
    assert!(!missing(&["one 7", "two [1.0, 4]", "three"]));
    assert!(!missing(&["one 7", "..."]) && !missing(&["...", "three"]));
    assert!(missing(&["one 7", "three"]) && missing(&["one 7"]));
    assert!(missing(&["...", "four"]) && missing(&["one a", "..."]));
}
