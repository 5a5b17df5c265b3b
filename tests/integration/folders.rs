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
