//! Why actions ran: what their keys were made of last time, beside what they are made of now.
//!
//! The fields of the last keys stand in the cache's folder, a file an asset. They are those that were hashed, so an
//! explanation cannot disagree with a key.

use std::collections::BTreeMap;

use super::key::{Digest, Field, INPUT};
use super::store::Store;

/// Folder of the files.
const FOLDER: &str = "last";

/// Why an action runs though a store may have its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Why {
    /// The user wants it.
    Forced,
    /// Its stored result was damaged, or is gone.
    Lost,
}

/// The fields of an asset's keys by action, as in `level 2 fine`.
pub type Fields = BTreeMap<String, Vec<Field>>;

/// What the keys of the asset `name` were made of last time; nothing, where that cannot be read.
pub fn last(store: &Store, name: &str) -> Fields {
    store.note(&place(name)).and_then(|bytes| serde_json::from_slice(&bytes).ok()).unwrap_or_default()
}

/// Remembers what the keys of the asset `name` are made of.
pub fn remember(store: &Store, name: &str, fields: &Fields) {
    store.keep_note(&place(name), &serde_json::to_vec(fields).expect("text is JSON"));
}

fn place(name: &str) -> String {
    // A name may hold what no file name may.
    format!("{FOLDER}/{}", Digest::of(name.as_bytes()))
}

/// Why an action with the fields `new` ran, a reason each.
pub fn reasons(old: Option<&Vec<Field>>, new: &[Field], why: Option<Why>) -> Vec<String> {
    if why == Some(Why::Forced) {
        return vec!["`--force`".into()];
    }
    let Some(old) = old else { return vec!["it is not known to have run before".into()] };
    let value =
        |fields: &[Field], name: &str| fields.iter().find(|field| field.name == name).map(|field| field.value.clone());
    let mut reasons: Vec<String> = Vec::new();
    let gone = old.iter().filter(|field| value(new, &field.name).is_none());
    for field in new.iter().chain(gone) {
        let [before, now] = [old, new].map(|fields| value(fields, &field.name));
        if before != now {
            let reason = change(&field.name, before.as_deref(), now.as_deref());
            if !reasons.contains(&reason) {
                reasons.push(reason);
            }
        }
    }
    if reasons.is_empty() {
        reasons.push(match why {
            Some(Why::Lost) => "its stored result was damaged or evicted".into(),
            _ => "its result is not in the cache".into(),
        });
    }
    reasons
}

/// One change in words. What levels share is told once: their numbers are left out.
fn change(name: &str, before: Option<&str>, now: Option<&str>) -> String {
    if let Some(input) = name.strip_prefix(INPUT) {
        let short = |digest: Option<&str>| digest.map_or("none".to_string(), |digest| digest.chars().take(8).collect());
        return format!("input `{input}` changed: {} -> {}", short(before), short(now));
    }
    let name = match name.strip_prefix("level ").and_then(|rest| rest.split_once(' ')) {
        Some((number, setting)) if number.bytes().all(|b| b.is_ascii_digit()) => setting,
        _ => name,
    };
    format!("`{name}` changed: {} -> {}", before.unwrap_or("none"), now.unwrap_or("none"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(pairs: &[(&str, &str)]) -> Vec<Field> {
        pairs.iter().map(|(name, value)| Field { name: name.to_string(), value: value.to_string() }).collect()
    }

    #[test]
    fn every_difference_is_told_once_with_both_values() {
        let old = fields(&[
            ("stage version", "1"),
            ("rank", "1"),
            ("level 1 patches", "4"),
            ("level 2 patches", "4"),
            ("seed", "7"),
        ]);
        let new = fields(&[
            ("stage version", "2"),
            ("rank", "1"),
            ("level 1 patches", "8"),
            ("level 2 patches", "8"),
            ("input heights", "0123456789"),
        ]);
        assert_eq!(
            reasons(Some(&old), &new, None),
            [
                "`stage version` changed: 1 -> 2",
                "`patches` changed: 4 -> 8",
                "input `heights` changed: none -> 01234567",
                "`seed` changed: 7 -> none"
            ]
        );
    }

    #[test]
    fn without_a_difference_the_store_is_at_fault() {
        let same = fields(&[("rank", "1")]);
        assert_eq!(reasons(Some(&same), &same, None), ["its result is not in the cache"]);
        assert_eq!(reasons(Some(&same), &same, Some(Why::Lost)), ["its stored result was damaged or evicted"]);
        assert_eq!(reasons(Some(&same), &same, Some(Why::Forced)), ["`--force`"]);
        assert_eq!(reasons(None, &same, None), ["it is not known to have run before"]);
    }
}
