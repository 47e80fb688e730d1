//! The model where none is named: the one that comes with the program, if it is there.

use super::failure::Failure;
use std::path::{Path, PathBuf};

/// The model of household things, which comes with the program.
const SHIPPED: &str = "household.safetensors";
/// Models that are named in one message.
const MOST_NAMED: usize = 8;

/// Where models are looked for: beside the program and above it, as an archive, an installation and a build lay them out, and where it was
/// started.
fn places() -> Vec<PathBuf> {
    let program = std::env::current_exe().and_then(|path| path.canonicalize()).unwrap_or_default();
    let beside = program.parent().unwrap_or(Path::new("")).to_owned();
    ["models", "../models", "../share/beo/models", "../../models"].iter().map(|place| beside.join(place)).chain(["models".into()]).collect()
}

/// The model that is meant.
pub fn or_shipped(given: Option<PathBuf>) -> Result<PathBuf, Failure> {
    match given {
        Some(path) => Ok(path),
        None => shipped_in(&places()),
    }
}

fn shipped_in(places: &[PathBuf]) -> Result<PathBuf, Failure> {
    if let Some(path) = places.iter().map(|place| place.join(SHIPPED)).find(|path| path.is_file()) {
        return Ok(path.canonicalize().unwrap_or(path));
    }
    let is_model = |path: &PathBuf| path.extension().is_some_and(|extension| extension == "safetensors");
    let mut found: Vec<String> = places
        .iter()
        .map(PathBuf::as_path)
        .chain([Path::new(".")])
        .filter_map(|place| std::fs::read_dir(place).ok())
        .flat_map(|entries| entries.filter_map(Result::ok).map(|entry| entry.path()))
        .filter(is_model)
        .map(|path| path.display().to_string())
        .collect();
    found.sort();
    let more = found.len().saturating_sub(MOST_NAMED);
    let others = if more > 0 { format!(" and {more} more") } else { String::new() };
    found.truncate(MOST_NAMED);
    Err(Failure::Usage(match found.is_empty() {
        true => format!("no model: give --model FILE ({SHIPPED} does not lie beside the program), or train one with `beo train`"),
        false => format!("no model: give --model FILE; there are {}{others}", found.join(", ")),
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_shipped_model_is_meant_and_others_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let places = ["none", "models"].map(|place| folder.path().join(place));
        std::fs::create_dir(&places[1]).unwrap();
        std::fs::write(places[1].join("mine.safetensors"), "").unwrap();
        let message = shipped_in(&places).unwrap_err().to_string();
        assert!(message.contains("there are") && message.contains("models/mine.safetensors"), "{message}");
        std::fs::write(places[1].join(SHIPPED), "").unwrap();
        assert!(shipped_in(&places).unwrap().ends_with("models/household.safetensors"));
        assert_eq!(or_shipped(Some("a".into())).unwrap(), Path::new("a"));
    }
}
