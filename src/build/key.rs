//! What an action's key is made of.
//!
//! A [`Walk`] visits everything that the outputs of an action depend on: its stage and the stage's version, its settings
//! in a fixed order, the digests of its inputs. The list that it leaves is hashed into the key and kept for
//! [`super::explain`], so that an explanation cannot disagree with the key. Paths, times, thread counts and host names
//! are never visited.

use std::fmt::{self, Debug, Display, Formatter};

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Instruction set whose bits the kernels give: every copy of a kernel gives those of the baseline (`math::simd`), and
/// the FFT runs its scalar code.
pub const ISA: &str = "baseline";

/// A BLAKE3 digest: of bytes, or of a [`Walk`], whose key it is then.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Digest([u8; 32]);

impl Digest {
    /// The digest of `bytes`.
    pub fn of(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// The digest that 64 hex digits write out.
    pub fn from_hex(text: &str) -> Option<Self> {
        blake3::Hash::from_hex(text).ok().map(|hash| Self(*hash.as_bytes()))
    }

    /// The first digits, enough for people.
    pub fn short(&self) -> String {
        self.to_string()[..8].into()
    }
}

impl From<blake3::Hash> for Digest {
    fn from(hash: blake3::Hash) -> Self {
        Self(*hash.as_bytes())
    }
}

impl Display for Digest {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(&blake3::Hash::from_bytes(self.0).to_hex())
    }
}

impl Debug for Digest {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        Display::fmt(self, f)
    }
}

impl Serialize for Digest {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

impl<'de> Deserialize<'de> for Digest {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = String::deserialize(deserializer)?;
        Self::from_hex(&text).ok_or_else(|| serde::de::Error::custom("wanted 64 hex digits"))
    }
}

/// What one thing is that an action depends on, and its value in one canonical form.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Field {
    /// `stage version`, the name of a setting, or `input` with the input's name.
    pub name: String,
    /// The value as text.
    pub value: String,
}

/// A list of all that an action depends on.
#[derive(Clone, Debug)]
pub struct Walk {
    fields: Vec<Field>,
}

impl Walk {
    /// The walk of an action of `stage`, whose code is at `version`.
    pub fn new(stage: &str, version: u32) -> Self {
        let mut walk = Self { fields: Vec::with_capacity(16) };
        walk.push("stage".into(), stage.into());
        walk.push("stage version".into(), version.to_string());
        walk.push("instruction set".into(), ISA.into());
        walk
    }

    /// A setting. `Debug` of numbers is the shortest text that reads back as the same number.
    pub fn setting(&mut self, name: &str, value: impl Debug) {
        self.push(name.into(), format!("{value:?}"));
    }

    /// An input by its content.
    pub fn input(&mut self, name: &str, digest: Digest) {
        self.push(format!("{INPUT}{name}"), digest.to_string());
    }

    fn push(&mut self, name: String, value: String) {
        self.fields.push(Field { name, value });
    }

    /// The key: BLAKE3 of all names and values, each after its length.
    pub fn key(&self) -> Digest {
        let mut hasher = blake3::Hasher::new();
        for text in self.fields.iter().flat_map(|field| [&field.name, &field.value]) {
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        }
        hasher.finalize().into()
    }

    /// All that was visited, in order.
    pub fn into_fields(self) -> Vec<Field> {
        self.fields
    }
}

/// What the name of an input begins with among the fields.
pub(super) const INPUT: &str = "input ";

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_a_walk_reaches_the_key() {
        let walk = |stage: &str, version, name: &str, value: f32| {
            let mut walk = Walk::new(stage, version);
            walk.setting(name, value);
            walk.key()
        };
        let key = walk("lobes", 1, "count", 2.0);
        assert_eq!(key, walk("lobes", 1, "count", 2.0));
        let others = [
            walk("fine", 1, "count", 2.0),
            walk("lobes", 2, "count", 2.0),
            walk("lobes", 1, "c", 2.0),
            walk("lobes", 1, "count", 2.000_000_2),
        ];
        assert!(others.iter().all(|other| *other != key));
    }

    #[test]
    fn where_one_text_ends_and_the_next_begins_is_part_of_the_key() {
        let key = |[a, b]: [&str; 2]| {
            let mut walk = Walk::new("s", 1);
            walk.push(a.into(), b.into());
            walk.key()
        };
        assert_ne!(key(["ab", "c"]), key(["a", "bc"]));
    }

    #[test]
    fn a_digest_reads_what_it_writes() {
        let digest = Digest::of(b"bark");
        assert_eq!(Digest::from_hex(&digest.to_string()), Some(digest));
        assert_eq!(Digest::from_hex("ab"), None);
        let json = serde_json::to_string(&digest).unwrap();
        assert_eq!(serde_json::from_str::<Digest>(&json).unwrap(), digest);
    }
}
