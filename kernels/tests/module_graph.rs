//! The modules of the crate use each other without cycles.
//!
//! Read from the `use` lines of the sources. What a module declares or re-exports of its own children is not counted:
//! a child may use its parent, which holds it. Test modules are not counted either.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

type Module = Vec<String>;

/// The sources by module, (path of the module, text without comments and tests).
fn modules(folder: &Path, parent: &Module, found: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_string_lossy().into_owned();
        let mut module = parent.clone();
        if path.is_dir() {
            module.push(stem);
            modules(&path, &module, found);
            continue;
        }
        if stem != "mod" && stem != "lib" {
            module.push(stem);
        }
        let text = fs::read_to_string(&path).unwrap();
        let text = text.split("#[cfg(test)]\nmod ").next().unwrap();
        let code = text.lines().map(|line| line.split("//").next().unwrap());
        found.insert(module, code.collect::<Vec<_>>().join("\n"));
    }
}

/// The module that a `use` path names, as far as it is one; None outside the crate and for own children.
fn target(module: &Module, path: &str, known: &BTreeMap<Module, String>) -> Option<Module> {
    let names = path.split("::").map(str::trim);
    let mut names = names.take_while(|name| !name.starts_with('{')).peekable();
    let mut found = match *names.peek()? {
        "crate" => {
            names.next();
            Module::new()
        }
        "super" => module.clone(),
        _ => return None,
    };
    while names.next_if_eq(&"super").is_some() {
        found.pop();
    }
    found.extend(names.map(str::to_owned));
    while !known.contains_key(&found) {
        found.pop()?;
    }
    (found != *module).then_some(found)
}

/// What follows each `use` that begins a line, up to its semicolon.
fn uses(text: &str) -> impl Iterator<Item = &str> {
    text.split('\n')
        .enumerate()
        .filter_map(move |(number, line)| {
            let line = line.trim_start();
            let declared = ["use ", "pub use ", "pub(crate) use ", "pub(super) use "];
            declared.iter().find(|d| line.starts_with(**d))?;
            let start = text
                .split('\n')
                .take(number)
                .map(|l| l.len() + 1)
                .sum::<usize>();
            let statement = text[start..].split(';').next()?;
            Some(statement.split_once("use ")?.1)
        })
}

/// Remove the modules that use none of those left, until no more can be removed.
fn cyclic(mut edges: BTreeMap<Module, BTreeSet<Module>>) -> Vec<Module> {
    loop {
        let left: BTreeSet<Module> = edges.keys().cloned().collect();
        let before = edges.len();
        edges.retain(|_, targets| targets.iter().any(|target| left.contains(target)));
        if edges.len() == before {
            return edges.into_keys().collect();
        }
    }
}

#[test]
fn the_modules_use_each_other_without_cycles() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut known = BTreeMap::new();
    modules(&source, &Module::new(), &mut known);
    let edges: BTreeMap<Module, BTreeSet<Module>> = known
        .iter()
        .map(|(module, text)| {
            let targets = uses(text).filter_map(|path| target(module, path, &known));
            (module.clone(), targets.collect())
        })
        .collect();
    assert!(known.len() > 20, "only {} modules were read", known.len());
    assert!(edges.values().map(BTreeSet::len).sum::<usize>() > known.len());
    let cyclic = cyclic(edges);
    assert!(
        cyclic.is_empty(),
        "these use each other, or what does: {cyclic:?}"
    );
}

#[test]
fn a_cycle_is_seen() {
    let module = |name: &str| vec![name.to_owned()];
    let edge = |from: &str, to: &str| (module(from), BTreeSet::from([module(to)]));
    let edges = BTreeMap::from([edge("a", "b"), edge("b", "a"), edge("c", "d")]);
    assert_eq!(cyclic(edges), [module("a"), module("b")]);
}
