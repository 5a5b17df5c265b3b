//! Parameter sets line by line.

use oblate::params::{NAMES, ParameterLine, ParameterLines};
use std::io::{BufReader, Read};
use std::path::PathBuf;

fn line() -> String {
    let pairs: Vec<String> = NAMES
        .iter()
        .map(|name| format!("\"{name}\": 1.5"))
        .collect();
    format!("{{{}}}", pairs.join(", "))
}

/// The numbers of the lines that were read, and the message about the first that was not.
fn read(input: impl Read) -> (Vec<usize>, Option<String>) {
    let mut input = BufReader::new(input);
    let mut numbers = Vec::new();
    for line in ParameterLines::new(&mut input, PathBuf::from("standard input")) {
        match line {
            Ok(line) => {
                for params in line.points {
                    let given = params.to_array().map(|x| x.unwrap_or(f64::NAN));
                    assert!(given.iter().all(|x| (x - 1.5).abs() < 1e-15));
                }
                numbers.push(line.number);
            }
            Err(error) => return (numbers, Some(error.to_string())),
        }
    }
    (numbers, None)
}

#[test]
fn lines_are_numbered_and_empty_ones_are_left_out() {
    let text = format!("{}\n\n  \r\n{}\n{}", line(), line(), line());
    assert_eq!(read(text.as_bytes()), (vec![1, 4, 5], None));
}

#[test]
fn a_line_may_be_a_list_and_leave_parameters_out() {
    let text = format!("[{}, {}]\n[]\n{{\"age_gyr\": 2.0}}\n", line(), line());
    let mut input = text.as_bytes();
    let lines: Vec<ParameterLine> = ParameterLines::new(&mut input, PathBuf::from("lines"))
        .collect::<oblate::Result<_>>()
        .unwrap();
    let shapes = lines.iter().map(|l| (l.number, l.points.len(), l.is_list));
    assert_eq!(
        shapes.collect::<Vec<_>>(),
        [(1, 2, true), (2, 0, true), (3, 1, false)]
    );
    let given = lines[2].points[0];
    assert_eq!(given.age_gyr, Some(2.0));
    assert_eq!(given.to_array().iter().flatten().count(), 1);
}

#[test]
fn a_line_without_parameter_sets_is_refused_by_its_number() {
    for bad in [
        "1.5".to_owned(),
        "[1.5]".to_owned(),
        format!("[{}", line()),
        line().replace("1.5", "1e999"),
        line().replace("age_gyr", "age"),
        "[".repeat(20_000),
        "\u{feff}".to_owned() + &line(),
    ] {
        let (numbers, error) = read(format!("{}\n{bad}\n", line()).as_bytes());
        let words = error.unwrap();
        assert_eq!(numbers, [1]);
        assert!(
            words.starts_with("standard input, line 2: ") && words.contains("; give one"),
            "{words}"
        );
    }
    let (_, error) = read(&b"\xff\xfe\n"[..]);
    assert!(error.unwrap().contains("line 1"));
}

#[test]
fn a_line_without_an_end_is_refused_after_4_mib() {
    // A quintillion spaces.
    let (numbers, error) = read(std::io::repeat(b' '));
    assert!(numbers.is_empty() && error.unwrap().contains("line 1: longer than 4 MiB"));
}
