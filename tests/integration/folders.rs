//! Folders as tests see them: all that is in one, and a copy of one.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Every file below a folder with its content, every other entry with none; links are not followed.
pub fn tree(folder: &Path) -> BTreeMap<PathBuf, Option<Vec<u8>>> {
    let mut found = BTreeMap::new();
    let mut next = vec![folder.to_path_buf()];
    while let Some(path) = next.pop() {
        for entry in std::fs::read_dir(&path).unwrap() {
            let entry = entry.unwrap();
            let (path, kind) = (entry.path(), entry.file_type().unwrap());
            let content = kind.is_file().then(|| std::fs::read(&path).unwrap());
            if kind.is_dir() {
                next.push(path.clone());
            }
            found.insert(path.strip_prefix(folder).unwrap().to_path_buf(), content);
        }
    }
    found
}

/// Copies a folder and all in it.
pub fn copy(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for (path, content) in tree(from) {
        match content {
            Some(bytes) => std::fs::write(to.join(path), bytes).unwrap(),
            None => std::fs::create_dir_all(to.join(path)).unwrap(),
        }
    }
}

/// Every file below a folder by its name. Times are taken out of summaries; files with times and the number of
/// processes of a run are left out: logs, checkpoints, the page with the times of its runs.
pub fn files(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut left = vec![folder.to_path_buf()];
    while let Some(next) = left.pop() {
        for entry in std::fs::read_dir(&next).expect("a folder") {
            let path = entry.expect("an entry").path();
            let name = path
                .file_name()
                .expect("a name")
                .to_string_lossy()
                .into_owned();
            if path.is_dir() {
                left.push(path);
                continue;
            }
            if name == "log.jsonl" || name.starts_with("checkpoint") || name == "report.html" {
                continue;
            }
            let mut bytes = std::fs::read(&path).expect("a file");
            if name == "summary.json" {
                bytes = without_times(&bytes);
            }
            let name = path.strip_prefix(folder).expect("below").to_path_buf();
            found.insert(name, bytes);
        }
    }
    found
}

fn without_times(summary: &[u8]) -> Vec<u8> {
    let mut value: serde_json::Value = serde_json::from_slice(summary).expect("a summary");
    for key in ["cpu_seconds", "wall_seconds"] {
        value["cost"][key] = 0.into();
    }
    // The command line differs where a run is continued.
    value["command"] = "".into();
    serde_json::to_vec(&value).expect("JSON")
}
