//! Finds circles of imports between the files of a crate.
//!
//! A file imports another one if its code names an item that is defined there: by a `use`, or by a path in the code that begins
//! with `crate`, `super`, `self`, a child module or an imported module. Names are followed through re-exports to the file that
//! defines them. A re-export is an import only if the code of the same file uses the name. Methods count too: a file that calls, in an
//! `impl` block, a method of the type that another file's inherent `impl` block defines imports that file. Tests are left out.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A module's path from the crate's root, whose own is empty.
type Module = Vec<String>;

/// The names in the code of one file.
#[derive(Default)]
struct Source {
    /// Path of the file below `src`.
    file: String,
    /// Items defined at the file's outermost level.
    items: BTreeSet<String>,
    /// Names brought in by `use`, with the paths that they stand for.
    names: BTreeMap<String, Vec<String>>,
    /// Modules of which all names are brought in.
    globs: Vec<Vec<String>>,
    /// Paths of which the code makes use.
    paths: BTreeSet<Vec<String>>,
    /// Methods that inherent `impl` blocks define, with the name of their type.
    methods: BTreeSet<(String, String)>,
    /// Methods that `impl` blocks call on their own type, with its name.
    calls: BTreeSet<(String, String)>,
}

/// The destination of a path.
enum Found {
    Module(Module),
    /// An item, in the file of this module.
    Item(Module),
}

/// Groups of files that import each other, directly or around a circle; each group sorted.
pub fn circles(src: &Path) -> Vec<Vec<String>> {
    let imports = imports(src);
    let reached: BTreeMap<&String, BTreeSet<&String>> = imports
        .keys()
        .map(|from| (from, reached_from(from, &imports)))
        .collect();
    let mut circles = BTreeSet::new();
    for (from, to) in &reached {
        if to.contains(*from) {
            let circle = to.iter().filter(|other| reached[**other].contains(*from));
            circles.insert(circle.map(|file| (*file).clone()).collect::<Vec<_>>());
        }
    }
    circles.into_iter().collect()
}

/// Every file of a crate with the files that it imports.
pub fn imports(src: &Path) -> BTreeMap<String, BTreeSet<String>> {
    let sources: BTreeMap<Module, Source> = rust_files(src)
        .into_iter()
        .map(|file| {
            let below = file.strip_prefix(src).unwrap().to_path_buf();
            (module_of(&below), Source::read(&file, &below))
        })
        .collect();
    let mut imports = BTreeMap::new();
    let methods = methods(&sources);
    for (module, source) in &sources {
        let mut used = BTreeSet::new();
        for (name, method) in &source.calls {
            let definer = owner(&sources, module, name)
                .and_then(|owner| methods.get(&(owner, name.clone(), method.clone())));
            used.extend(definer.filter(|file| **file != source.file).cloned());
        }
        for path in &source.paths {
            if let Some(Found::Item(owner)) = resolve(&sources, module, path, 0)
                && owner != *module
            {
                used.insert(sources[&owner].file.clone());
            }
        }
        imports.insert(source.file.clone(), used);
    }
    imports
}

/// The module that defines a type of this name, as `from` sees it.
fn owner(sources: &BTreeMap<Module, Source>, from: &Module, name: &str) -> Option<Module> {
    match resolve(sources, from, &[name.to_owned()], 0)? {
        Found::Item(owner) => Some(owner),
        Found::Module(_) => None,
    }
}

/// The file of every method of an inherent `impl` block, by the module and the name of its type and its own name.
fn methods(sources: &BTreeMap<Module, Source>) -> BTreeMap<(Module, String, String), String> {
    let mut files = BTreeMap::new();
    for (module, source) in sources {
        for (name, method) in &source.methods {
            if let Some(owner) = owner(sources, module, name) {
                files.insert((owner, name.clone(), method.clone()), source.file.clone());
            }
        }
    }
    files
}

fn reached_from<'a>(
    from: &'a String,
    imports: &'a BTreeMap<String, BTreeSet<String>>,
) -> BTreeSet<&'a String> {
    let mut reached = BTreeSet::new();
    let mut next: Vec<&String> = imports[from].iter().collect();
    while let Some(file) = next.pop() {
        if reached.insert(file) {
            next.extend(&imports[file]);
        }
    }
    reached
}

/// Follows a path from a module to a module or to the file of an item. `None`: it leads outside the crate.
fn resolve(
    sources: &BTreeMap<Module, Source>,
    from: &Module,
    path: &[String],
    depth: usize,
) -> Option<Found> {
    // Re-exports that name each other end here.
    if depth > 20 {
        return None;
    }
    let mut module = from.clone();
    for (at, name) in path.iter().enumerate() {
        let last = at + 1 == path.len();
        match name.as_str() {
            "crate" => module.clear(),
            "self" => {}
            "super" => {
                module.pop()?;
            }
            "*" => return Some(Found::Item(module)),
            _ => {
                let source = sources.get(&module)?;
                let mut child = module.clone();
                child.push(name.clone());
                let is_module = sources.contains_key(&child);
                if source.items.contains(name) && (last || !is_module) {
                    return Some(Found::Item(module));
                }
                // A function may have the name of its module: at the end of a path it is meant.
                let imported = source.names.get(name).filter(|_| last || !is_module);
                if let Some(import) = imported
                    && !(at == 0 && import.as_slice() == path)
                {
                    match resolve(sources, &module, import, depth + 1) {
                        Some(Found::Module(other)) => {
                            module = other;
                            continue;
                        }
                        Some(item) => return Some(item),
                        None if !is_module => return None,
                        None => {}
                    }
                }
                if is_module {
                    module = child;
                    continue;
                }
                return source
                    .globs
                    .iter()
                    .filter_map(|glob| match resolve(sources, &module, glob, depth + 1)? {
                        Found::Module(other) if other != module => {
                            resolve(sources, &other, &path[at..], depth + 1)
                        }
                        _ => None,
                    })
                    .next();
            }
        }
    }
    Some(Found::Module(module))
}

impl Source {
    fn read(file: &Path, below: &Path) -> Self {
        let text = fs::read_to_string(file).unwrap();
        let mut source = Self {
            file: below.display().to_string(),
            ..Self::default()
        };
        let mut exports = Vec::new();
        let mut body = String::new();
        let code = code_of(&text);
        source.read_methods(&code);
        let mut rest = code.as_str();
        while !rest.is_empty() {
            let (line, after) = rest.split_once('\n').unwrap_or((rest, ""));
            let (exported, statement) = without_visibility(line.trim_start());
            if let Some(found) = statement.strip_prefix("use ") {
                let start = found.as_ptr() as usize - rest.as_ptr() as usize;
                let end = start + rest[start..].find(';').unwrap();
                let tree: String = rest[start..end]
                    .split_whitespace()
                    .collect::<Vec<_>>()
                    .join(" ");
                for (name, path) in leaves(&tree) {
                    source.bring_in(name, path, exported, &mut exports);
                }
                rest = &rest[end + 1..];
                continue;
            }
            if !line.starts_with(' ') {
                source.items.extend(item_of(statement));
            }
            // The declaration of a child is no use of it.
            if !statement.starts_with("mod ") {
                body.push_str(line);
                body.push('\n');
            }
            rest = after;
        }
        for path in paths(&body) {
            let [first, ..] = path.as_slice() else {
                continue;
            };
            if let Some(exported) = exports.iter().find(|(name, _)| name == first) {
                source.paths.insert(exported.1.clone());
            }
            source.paths.insert(path);
        }
        source
    }

    /// Records the methods that `impl` blocks define and call; a block ends where a line begins with a brace.
    fn read_methods(&mut self, code: &str) {
        let mut block: Option<(String, bool)> = None;
        for line in code.lines() {
            if line.starts_with("impl") {
                block = implemented(line);
            } else if line.starts_with('}') {
                block = None;
            }
            let Some((name, inherent)) = &block else {
                continue;
            };
            let (_, statement) = without_visibility(line.trim_start());
            let defined = item_of(statement)
                .filter(|_| line.starts_with("    ") && !line.starts_with("     "));
            if let Some(method) = defined.filter(|_| *inherent) {
                self.methods.insert((name.clone(), method));
            }
            for prefix in ["self.", "Self::"] {
                for (at, _) in line.match_indices(prefix) {
                    let rest = &line[at + prefix.len()..];
                    if let Some(method) = identifier(rest)
                        && rest[method.len()..].starts_with('(')
                    {
                        self.calls.insert((name.clone(), method));
                    }
                }
            }
        }
    }

    /// Records one name of a `use`; it is imported at once unless it is only exported.
    fn bring_in(
        &mut self,
        name: String,
        path: Vec<String>,
        exported: bool,
        exports: &mut Vec<(String, Vec<String>)>,
    ) {
        if name == "*" {
            if !exported {
                self.paths.insert(path.clone());
            }
            self.globs.push(path[..path.len() - 1].to_vec());
            return;
        }
        if exported {
            exports.push((name.clone(), path.clone()));
        } else {
            self.paths.insert(path.clone());
        }
        self.names.insert(name, path);
    }
}

/// Code without comments and without the tests at its end.
fn code_of(text: &str) -> String {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap();
    let lines = code.lines().map(|line| {
        let line = line.split("// ").next().unwrap();
        if line.trim_start().starts_with("//") {
            String::new()
        } else {
            // The command names its library as others do.
            line.replace("oblate::", "crate::")
        }
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// Whether a statement is public in any degree, and the statement without that.
fn without_visibility(statement: &str) -> (bool, &str) {
    let Some(rest) = statement.strip_prefix("pub") else {
        return (false, statement);
    };
    match rest.strip_prefix('(') {
        Some(limited) => {
            let rest = limited.split_once(") ").map_or(limited, |(_, rest)| rest);
            (true, rest)
        }
        None => (true, rest.trim_start()),
    }
}

/// The name that a line defines, if it is the first one of an item.
fn item_of(statement: &str) -> Option<String> {
    const KINDS: [&str; 9] = [
        "fn",
        "struct",
        "enum",
        "trait",
        "type",
        "const",
        "static",
        "union",
        "macro_rules!",
    ];
    let mut words = statement.split_whitespace().peekable();
    while let Some(word) = words.next() {
        let next = words.peek().copied().unwrap_or("");
        if KINDS.contains(&word) && !["fn", "unsafe", "extern"].contains(&next) {
            return identifier(next);
        }
        if !["unsafe", "const", "async", "extern", "\"C\""].contains(&word) {
            return None;
        }
    }
    None
}

/// The type of an `impl` block by its first line, and whether the block is inherent.
fn implemented(line: &str) -> Option<(String, bool)> {
    let mut rest = line.strip_prefix("impl")?;
    if rest.starts_with('<') {
        let mut depth = 0;
        let end = rest.char_indices().find(|(_, c)| {
            depth += i32::from(*c == '<') - i32::from(*c == '>');
            depth == 0
        });
        rest = &rest[end?.0 + 1..];
    }
    let name = rest.split_once(" for ").map_or(rest, |(_, name)| name);
    Some((identifier(name.trim_start())?, !rest.contains(" for ")))
}

fn identifier(text: &str) -> Option<String> {
    let name: String = text
        .chars()
        .take_while(|c| c.is_alphanumeric() || *c == '_')
        .collect();
    (!name.is_empty()).then_some(name)
}

/// Names that a `use` brings in, with their paths: `a::{self, b as c}` brings in `a` and `c`.
fn leaves(tree: &str) -> Vec<(String, Vec<String>)> {
    let tree = tree.trim();
    if let Some((prefix, group)) = tree.split_once('{') {
        let prefix: Vec<String> = segments(prefix);
        let group = &group[..group.rfind('}').unwrap()];
        let (mut depth, mut start, mut parts) = (0, 0, Vec::new());
        for (at, c) in group.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    parts.push(&group[start..at]);
                    start = at + 1;
                }
                _ => {}
            }
        }
        parts.push(&group[start..]);
        let parts = parts.into_iter().filter(|part| !part.trim().is_empty());
        return parts
            .flat_map(leaves)
            .map(|(name, path)| {
                let mut whole = prefix.clone();
                if path == ["self"] {
                    let own = if name == "self" {
                        whole[whole.len() - 1].clone()
                    } else {
                        name
                    };
                    return (own, whole);
                }
                whole.extend(path);
                (name, whole)
            })
            .collect();
    }
    let (path, alias) = match tree.split_once(" as ") {
        Some((path, alias)) => (path, Some(alias.trim().to_owned())),
        None => (tree, None),
    };
    let path = segments(path);
    let name = alias.or_else(|| path.last().cloned()).unwrap_or_default();
    vec![(name, path)]
}

fn segments(path: &str) -> Vec<String> {
    let names = path.split("::").map(str::trim);
    names.filter(|s| !s.is_empty()).map(str::to_owned).collect()
}

/// Paths in code: names joined by `::`, a single name among them.
fn paths(code: &str) -> BTreeSet<Vec<String>> {
    let mut found = BTreeSet::new();
    let mut rest = code;
    let mut before = ' ';
    while let Some(c) = rest.chars().next() {
        if !(c.is_alphabetic() || c == '_') {
            before = c;
            rest = &rest[c.len_utf8()..];
            continue;
        }
        let mut path = Vec::new();
        while let Some(name) = identifier(rest) {
            rest = &rest[name.len()..];
            path.push(name);
            match rest.strip_prefix("::") {
                Some(next) => rest = next,
                None => break,
            }
        }
        // A field, a method or the rest of a longer path is no path of its own.
        if before != '.' && before != ':' && !before.is_numeric() {
            found.insert(path);
        }
        before = 'a';
    }
    found
}

/// The module that a file below `src` holds.
fn module_of(below: &Path) -> Module {
    let mut module: Module = below
        .with_extension("")
        .iter()
        .map(|part| part.to_str().unwrap().to_owned())
        .collect();
    if module.last().is_some_and(|name| name == "mod") || module == ["lib"] {
        module.pop();
    }
    module
}

/// Every source file below a folder, but for files of tests.
pub fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(rust_files(&path));
        } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests.rs") {
            files.push(path);
        }
    }
    files.sort();
    files
}
