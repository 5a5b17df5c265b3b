//! The log: complete lines, also if the last one was interrupted.

use oblate::run::Log;
use serde_json::json;

#[test]
fn the_log_appends_one_object_per_line() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("log.jsonl");
    for step in 0..2 {
        // Opened twice, as a resumed run does.
        let log = Log::append_to(&path).unwrap();
        log.write(&json!({"step": step})).unwrap();
    }
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(text, "{\"step\":0}\n{\"step\":1}\n");
}

#[test]
fn a_line_that_a_killed_run_left_incomplete_is_ended_before_the_next() {
    let temporary = tempfile::tempdir().unwrap();
    let path = temporary.path().join("log.jsonl");
    std::fs::write(&path, "{\"step\":0}\n{\"st").unwrap();
    let log = Log::append_to(&path).unwrap();
    for step in 1..3 {
        log.write(&json!({"step": step})).unwrap();
    }
    let text = std::fs::read_to_string(&path).unwrap();
    assert_eq!(text, "{\"step\":0}\n{\"st\n{\"step\":1}\n{\"step\":2}\n");
}
