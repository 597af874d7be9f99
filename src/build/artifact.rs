//! What actions make and hand to each other, and how it is stored: a tag, counts, then little-endian numbers.

use std::collections::BTreeMap;

use formats::asset::{Figure, LevelError};

use crate::geometry::{Boundary, HeightField};
use crate::prefilter::surface::additive::AdditiveTerm;
use crate::prefilter::surface::reflectance::PatchReflectance;
use crate::prefilter::surface::{Alternative, Choice, FineTables, Interreflection, LevelFit, TableSizes, VmfLobe};

/// The result of an action.
#[derive(Clone, Debug, PartialEq)]
pub enum Artifact {
    /// Heights of a map or of a level.
    Heights(HeightField),
    /// RGB a texel or a cell; `None` where a surface has no colour map.
    Colors(Option<Vec<[f32; 3]>>),
    /// Lobes of a level, `[lobe][cell]`.
    Lobes(Vec<Vec<VmfLobe>>),
    /// Sizes of a level's tables, and what was found with them.
    Choice(Choice),
    /// F of the fine surface.
    Fine(FineTables),
    /// F of the coarse surface.
    Reflectance(PatchReflectance),
    /// T and S, and the additive term.
    Fit(LevelFit),
    /// The measured error of a level.
    Error(LevelError),
    /// The files of an asset by name.
    Files(BTreeMap<String, Vec<u8>>),
}

impl Artifact {
    /// The files that it is stored as, by name; one without a name unless it is [`Self::Files`].
    pub fn encode(&self) -> Vec<(String, Vec<u8>)> {
        let mut out = Writer(Vec::new());
        match self {
            Self::Files(files) => return files.iter().map(|(name, bytes)| (name.clone(), bytes.clone())).collect(),
            Self::Heights(heights) => out.heights(heights),
            Self::Colors(None) => out.0.push(b'n'),
            Self::Colors(Some(colors)) => {
                out.0.push(b'c');
                out.triples(colors);
            }
            Self::Lobes(lobes) => out.lobes(lobes),
            Self::Choice(choice) => out.choice(choice),
            Self::Fine(FineTables { direct, interreflection, skipped_interreflection }) => {
                out.0.push(b'g');
                out.reflectance(direct);
                out.option(interreflection.as_ref(), |out, light| {
                    out.doubles(&[light.noise]);
                    out.reflectance(&light.reflectance);
                });
                out.option(*skipped_interreflection, |out, bound| out.doubles(&[bound]));
            }
            Self::Reflectance(table) => {
                out.0.push(b'f');
                out.reflectance(table);
            }
            Self::Fit(fit) => out.fit(fit),
            Self::Error(error) => {
                out.0.push(b'e');
                error.figures().iter().for_each(|(_, figure)| out.doubles(&[figure.value, figure.standard_error]));
            }
        }
        vec![(String::new(), out.0)]
    }

    /// The artifact of these files; `None` where they are not exactly one.
    pub fn decode(mut files: Vec<(String, Vec<u8>)>) -> Option<Self> {
        match files.as_slice() {
            [(name, _)] if name.is_empty() => {}
            _ => return Some(Self::Files(files.into_iter().collect())),
        }
        let bytes = files.pop()?.1;
        let (&tag, rest) = bytes.split_first()?;
        let mut read = Reader(rest);
        let artifact = match tag {
            b'h' => Self::Heights(read.heights()?),
            b'n' => Self::Colors(None),
            b'c' => Self::Colors(Some(read.triples()?)),
            b'l' => Self::Lobes(read.lobes()?),
            b's' => Self::Choice(read.choice()?),
            b'g' => Self::Fine(FineTables {
                direct: read.reflectance()?,
                interreflection: read.option(Reader::light)?,
                skipped_interreflection: read.option(Reader::double)?,
            }),
            b'f' => Self::Reflectance(read.reflectance()?),
            b't' => Self::Fit(read.fit()?),
            b'e' => Self::Error(read.error()?),
            _ => return None,
        };
        read.0.is_empty().then_some(artifact)
    }
}

struct Writer(Vec<u8>);

impl Writer {
    fn count(&mut self, count: usize) {
        self.0.extend((count as u64).to_le_bytes());
    }

    fn doubles(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }

    fn floats(&mut self, values: &[f32]) {
        self.count(values.len());
        self.0.reserve(4 * values.len());
        values.iter().for_each(|value| self.0.extend(value.to_le_bytes()));
    }

    fn triples(&mut self, values: &[[f32; 3]]) {
        self.floats(values.as_flattened());
    }

    fn tables(&mut self, tables: &[Vec<[f32; 3]>]) {
        self.count(tables.len());
        tables.iter().for_each(|table| self.triples(table));
    }

    fn text(&mut self, text: &str) {
        self.count(text.len());
        self.0.extend(text.as_bytes());
    }

    fn option<T>(&mut self, value: Option<T>, write: impl FnOnce(&mut Self, T)) {
        self.count(usize::from(value.is_some()));
        if let Some(value) = value {
            write(self, value);
        }
    }

    fn reflectance(&mut self, table: &PatchReflectance) {
        self.count(table.pair_count());
        self.floats(table.values());
    }

    fn sizes(&mut self, sizes: TableSizes) {
        let TableSizes { patches: [u, v], directions, rank } = sizes;
        [u, v, directions, rank].into_iter().for_each(|n| self.count(n));
    }

    fn choice(&mut self, choice: &Choice) {
        let Choice { sizes, predicted, alternatives, heights, tables } = choice;
        self.0.push(b's');
        self.sizes(*sizes);
        self.option(*predicted, |out, error| out.doubles(&[error]));
        self.count(alternatives.len());
        for Alternative { sizes, error } in alternatives {
            self.sizes(*sizes);
            self.doubles(&[*error]);
        }
        self.option(heights.as_ref(), Self::field);
        self.option(tables.as_ref(), |out, tables| tables.iter().for_each(|table| out.reflectance(table)));
    }

    fn heights(&mut self, heights: &HeightField) {
        self.0.push(b'h');
        self.field(heights);
    }

    fn field(&mut self, heights: &HeightField) {
        heights.size().iter().for_each(|&n| self.count(n));
        heights.spacing().iter().for_each(|metres| self.0.extend(metres.to_le_bytes()));
        self.count(match heights.boundary() {
            Boundary::Repeat => 0,
            Boundary::Clamp => 1,
        });
        self.floats(heights.heights());
    }

    fn lobes(&mut self, lobes: &[Vec<VmfLobe>]) {
        self.0.push(b'l');
        self.count(lobes.len());
        for cells in lobes {
            let numbers = |lobe: &VmfLobe| [lobe.mean[0], lobe.mean[1], lobe.mean[2], lobe.kappa, lobe.weight];
            self.floats(&cells.iter().flat_map(numbers).collect::<Vec<_>>());
        }
    }

    fn fit(&mut self, fit: &LevelFit) {
        self.0.push(b't');
        self.tables(&fit.spatial);
        self.tables(&fit.angular);
        self.option(fit.additive.as_ref(), |out, term| {
            out.count(term.directions);
            out.triples(&term.spatial);
            out.triples(&term.angular);
        });
        self.option(fit.skipped_interreflection, |out, bound| out.doubles(&[bound]));
        self.doubles(&[fit.on_node]);
        self.count(fit.warnings.len());
        fit.warnings.iter().for_each(|warning| self.text(warning));
    }
}

/// The bytes that are left; every length is held against them before anything is allocated.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take(&mut self, len: usize) -> Option<&[u8]> {
        let (taken, rest) = self.0.split_at_checked(len)?;
        self.0 = rest;
        Some(taken)
    }

    fn count(&mut self) -> Option<usize> {
        let bytes = self.take(8)?.try_into().ok()?;
        usize::try_from(u64::from_le_bytes(bytes)).ok()
    }

    fn doubles<const N: usize>(&mut self) -> Option<[f64; N]> {
        let mut values = [0.0; N];
        for (value, bytes) in values.iter_mut().zip(self.take(8 * N)?.as_chunks::<8>().0) {
            *value = f64::from_le_bytes(*bytes);
        }
        Some(values)
    }

    fn floats(&mut self) -> Option<Vec<f32>> {
        let len = self.count()?.checked_mul(4)?;
        Some(self.take(len)?.as_chunks::<4>().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect())
    }

    fn triples(&mut self) -> Option<Vec<[f32; 3]>> {
        let floats = self.floats()?;
        let (triples, rest) = floats.as_chunks::<3>();
        rest.is_empty().then(|| triples.to_vec())
    }

    /// `count` things, each of at least one byte.
    fn many<T>(&mut self, mut one: impl FnMut(&mut Self) -> Option<T>) -> Option<Vec<T>> {
        let count = self.count().filter(|count| *count <= self.0.len())?;
        (0..count).map(|_| one(self)).collect()
    }

    fn text(&mut self) -> Option<String> {
        let len = self.count()?;
        String::from_utf8(self.take(len)?.to_vec()).ok()
    }

    fn heights(&mut self) -> Option<HeightField> {
        let size = [self.count()?, self.count()?];
        let mut metres = || self.take(4)?.try_into().ok().map(f32::from_le_bytes).filter(|metres| *metres > 0.0);
        let spacing = [metres()?, metres()?];
        let boundary = match self.count()? {
            0 => Boundary::Repeat,
            1 => Boundary::Clamp,
            _ => return None,
        };
        let heights = self.floats()?;
        let is_whole = size[0].checked_mul(size[1]) == Some(heights.len()) && !heights.is_empty();
        is_whole.then(|| HeightField::new(heights, size, spacing, boundary))
    }

    /// Something that may be absent.
    fn option<T>(&mut self, read: impl FnOnce(&mut Self) -> Option<T>) -> Option<Option<T>> {
        match self.count()? {
            0 => Some(None),
            1 => read(self).map(Some),
            _ => None,
        }
    }

    fn reflectance(&mut self) -> Option<PatchReflectance> {
        let pairs = self.count()?;
        PatchReflectance::from_values(self.floats()?, pairs)
    }

    fn light(&mut self) -> Option<Interreflection> {
        let [noise] = self.doubles()?;
        Some(Interreflection { noise, reflectance: self.reflectance()? })
    }

    fn sizes(&mut self) -> Option<TableSizes> {
        let patches = [self.count()?, self.count()?];
        Some(TableSizes { patches, directions: self.count()?, rank: self.count()? })
    }

    fn double(&mut self) -> Option<f64> {
        self.doubles().map(|[value]| value)
    }

    fn choice(&mut self) -> Option<Choice> {
        Some(Choice {
            sizes: self.sizes()?,
            predicted: self.option(Self::double)?,
            alternatives: self.many(|read| Some(Alternative { sizes: read.sizes()?, error: read.double()? }))?,
            heights: self.option(Self::heights)?,
            tables: self.option(|read| Some([read.reflectance()?, read.reflectance()?]))?,
        })
    }

    fn lobes(&mut self) -> Option<Vec<Vec<VmfLobe>>> {
        self.many(|read| {
            let numbers = read.floats()?;
            let (lobes, rest) = numbers.as_chunks::<5>();
            let lobe = |&[x, y, z, kappa, weight]: &[f32; 5]| VmfLobe { mean: [x, y, z], kappa, weight };
            rest.is_empty().then(|| lobes.iter().map(lobe).collect())
        })
    }

    fn fit(&mut self) -> Option<LevelFit> {
        let spatial = self.many(Self::triples)?;
        let angular = self.many(Self::triples)?;
        let additive = self.option(|read| {
            Some(AdditiveTerm { directions: read.count()?, spatial: read.triples()?, angular: read.triples()? })
        })?;
        Some(LevelFit {
            spatial,
            angular,
            additive,
            skipped_interreflection: self.option(Self::double)?,
            on_node: self.double()?,
            warnings: self.many(Self::text)?,
        })
    }

    fn error(&mut self) -> Option<LevelError> {
        let mut figure = || {
            let [value, standard_error] = self.doubles()?;
            Some(Figure { value, standard_error })
        };
        Some(LevelError {
            below_75: figure()?,
            above_75: figure()?,
            on_node: figure()?,
            bias: figure()?,
            furnace: figure()?,
            reciprocity: figure()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples() -> Vec<Artifact> {
        let lobe = |k: f32| VmfLobe { mean: [0.1, k, 0.9], kappa: 3.0 * k, weight: 1.0 + k };
        let figure = |value| Figure { value, standard_error: 0.1 * value };
        let heights = HeightField::new(vec![1.0, -0.5, 0.0, 2.5, 1e-9, 3.0], [3, 2], [0.1, 0.2], Boundary::Clamp);
        let table = |first: u16| {
            PatchReflectance::from_values((first..first + 18).map(f32::from).collect(), 3).expect("two patches")
        };
        let sizes = TableSizes { patches: [4, 2], directions: 9, rank: 1 };
        let chosen = Choice {
            sizes,
            predicted: Some(0.02),
            alternatives: vec![Alternative { sizes, error: 0.02 }],
            heights: Some(heights.clone()),
            tables: Some([table(1), table(2)]),
        };
        let light = Interreflection { reflectance: table(3), noise: 0.25 };
        let fit = LevelFit {
            spatial: vec![vec![[1.0; 3]; 4]],
            angular: vec![vec![[0.5, 0.6, 0.7]; 9]],
            additive: None,
            skipped_interreflection: Some(0.001),
            on_node: 0.012_345_678_901_234_5,
            warnings: vec!["rough".into(), String::new()],
        };
        let term = AdditiveTerm { directions: 2, spatial: vec![[1.0; 3]], angular: vec![[0.1, 0.2, 0.3]; 16] };
        vec![
            Artifact::Heights(heights),
            Artifact::Colors(None),
            Artifact::Colors(Some(vec![[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])),
            Artifact::Lobes(vec![vec![lobe(0.1), lobe(0.2)], vec![lobe(0.3), lobe(0.4)]]),
            Artifact::Choice(Choice::fixed(sizes)),
            Artifact::Choice(chosen),
            Artifact::Fine(FineTables { direct: table(0), interreflection: None, skipped_interreflection: Some(1e-3) }),
            Artifact::Fine(FineTables {
                direct: table(0),
                interreflection: Some(light),
                skipped_interreflection: None,
            }),
            Artifact::Reflectance(table(7)),
            Artifact::Fit(LevelFit { additive: Some(term), ..fit.clone() }),
            Artifact::Fit(fit),
            Artifact::Error(LevelError {
                below_75: figure(0.1),
                above_75: figure(0.2),
                on_node: figure(0.3),
                bias: figure(-0.4),
                furnace: figure(0.5),
                reciprocity: figure(1.0 / 3.0),
            }),
            Artifact::Files([("a".to_string(), vec![1, 2]), ("b".into(), vec![])].into()),
        ]
    }

    #[test]
    fn what_is_stored_is_read_back_exactly() {
        for artifact in samples() {
            assert_eq!(Artifact::decode(artifact.encode()).as_ref(), Some(&artifact));
        }
    }

    #[test]
    fn no_truncation_and_no_count_is_taken_on_trust() {
        for artifact in samples().into_iter().filter(|artifact| !matches!(artifact, Artifact::Files(_))) {
            let bytes = artifact.encode().pop().unwrap().1;
            for len in 0..bytes.len() {
                assert_eq!(Artifact::decode(vec![(String::new(), bytes[..len].to_vec())]), None, "{artifact:?} {len}");
            }
            for at in 0..bytes.len() {
                let mut wild = bytes.clone();
                wild[at] = 0xff; // counts of 2^56 and more among them
                let _no_panic = Artifact::decode(vec![(String::new(), wild)]);
            }
        }
    }
}
