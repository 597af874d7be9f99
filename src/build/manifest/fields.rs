//! Typed access to the keys of one TOML table, noting every mistake and every key that nobody asked for.

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::Mistake;

/// The tables of an array whose mistakes are told one by one; where there are more, that is mistake enough.
const MAX_TABLES: usize = 64;

/// Title of the table that holds all others.
pub(super) const ROOT: &str = "manifest";

/// Mistakes found so far.
pub(super) struct Mistakes<'t> {
    text: &'t str,
    found: Vec<Mistake>,
    has_syntax_mistakes: bool,
}

impl<'t> Mistakes<'t> {
    /// None yet.
    pub(super) fn new(text: &'t str) -> Self {
        Self { text, found: Vec::new(), has_syntax_mistakes: false }
    }

    /// Notes a mistake at a byte offset.
    pub(super) fn push(&mut self, offset: usize, message: String) {
        self.found.push(Mistake::at(self.text, offset, message));
    }

    /// Notes a mistake of the text's syntax.
    pub(super) fn push_syntax(&mut self, offset: usize, message: String) {
        self.has_syntax_mistakes = true;
        self.push(offset, message);
    }

    /// Notes that something is not there, unless a syntax mistake may have swallowed it.
    pub(super) fn push_missing(&mut self, offset: usize, message: String) {
        if !self.has_syntax_mistakes {
            self.push(offset, message);
        }
    }

    /// All, in order of place, each once.
    pub(super) fn finish(mut self) -> Vec<Mistake> {
        self.found.sort();
        self.found.dedup();
        self.found
    }

    /// The source text of a value, on one line and not too long.
    fn excerpt(&self, value: &Spanned<DeValue<'_>>) -> String {
        let text = self.text.get(value.span()).unwrap_or_default();
        let line = text.split_whitespace().collect::<Vec<_>>().join(" ");
        match line.char_indices().nth(40) {
            Some((end, _)) => format!("{}…", &line[..end]),
            None => line,
        }
    }
}

/// An array of tables.
pub(super) struct Tables {
    /// Its key.
    pub(super) key: &'static str,
    /// What one of them is called in messages, with its number from 1.
    pub(super) item: &'static str,
    /// The most of them; there is one at least.
    pub(super) max: usize,
    /// What it may be, for messages.
    pub(super) wanted: &'static str,
}

/// The keys of one table.
pub(super) struct Fields<'a, 'i, 'm, 't> {
    table: &'a DeTable<'i>,
    title: String,
    start: usize,
    mistakes: &'m mut Mistakes<'t>,
    asked: Vec<&'static str>,
    /// Whether keys that nobody asked for are mistakes.
    are_keys_known: bool,
}

impl<'a, 'i, 'm, 't> Fields<'a, 'i, 'm, 't> {
    /// The table called `title`, whose header stands at byte `start`.
    pub(super) fn new(table: &'a DeTable<'i>, title: String, start: usize, mistakes: &'m mut Mistakes<'t>) -> Self {
        Self { table, title, start, mistakes, asked: Vec::new(), are_keys_known: true }
    }

    /// The value of `key`, if given, with the offset of the key.
    pub(super) fn raw(&mut self, key: &'static str) -> Option<(usize, &'a Spanned<DeValue<'i>>)> {
        if !self.asked.contains(&key) {
            self.asked.push(key);
        }
        self.table.get_key_value(key).map(|(key, value)| (key.span().start, value))
    }

    /// Whether `key` is given.
    pub(super) fn has(&self, key: &str) -> bool {
        self.table.contains_key(key)
    }

    /// The value of `key` through `read`; a mistake where it is given and `read` refuses it.
    pub(super) fn value<T>(
        &mut self,
        key: &'static str,
        wanted: &str,
        read: impl FnOnce(&DeValue<'i>) -> Option<T>,
    ) -> Option<T> {
        let (_, value) = self.raw(key)?;
        let read = read(value.get_ref());
        if read.is_none() {
            let found = self.mistakes.excerpt(value);
            self.mistakes.push(value.span().start, format!("`{key}` is `{found}`; wanted {wanted}"));
        }
        read
    }

    /// A mistake where `key` is not given.
    pub(super) fn require(&mut self, key: &'static str, wanted: &str) {
        if !self.has(key) {
            self.mistakes.push_missing(self.start, format!("`{}` has no `{key}`; wanted {wanted}", self.title));
        }
    }

    /// A mistake at this table.
    pub(super) fn mistake_here(&mut self, message: impl FnOnce(&str) -> String) {
        let message = message(&self.title);
        self.mistakes.push_missing(self.start, message);
    }

    /// A mistake at the value of `key`, which names something that is not there.
    pub(super) fn names_nothing(&mut self, key: &'static str, message: String) {
        let start = self.table.get(key).map_or(self.start, |value| value.span().start);
        self.mistakes.push_missing(start, message);
    }

    /// A mistake at the value of `key`.
    pub(super) fn mistake(&mut self, key: &'static str, message: String) {
        let start = self.table.get(key).map_or(self.start, |value| value.span().start);
        self.mistakes.push(start, message);
    }

    /// A mistake where `key` is given.
    pub(super) fn refuse(&mut self, key: &'static str, message: &str) {
        if let Some((start, _)) = self.raw(key) {
            self.mistakes.push(start, message.into());
        }
    }

    /// A number that `accept` likes.
    pub(super) fn number(&mut self, key: &'static str, wanted: &str, accept: impl Fn(f64) -> bool) -> Option<f64> {
        self.value(key, wanted, |value| number(value).filter(|n| accept(*n)))
    }

    /// An integer from `min` to `max`.
    pub(super) fn integer(&mut self, key: &'static str, [min, max]: [u64; 2]) -> Option<u64> {
        let wanted = format!("an integer from {min} to {max}");
        self.value(key, &wanted, |value| integer(value).filter(|n| (min..=max).contains(n)))
    }

    /// `N` numbers that `accept` likes.
    pub(super) fn numbers<const N: usize>(
        &mut self,
        key: &'static str,
        wanted: &str,
        accept: impl Fn(f64) -> bool,
    ) -> Option<[f64; N]> {
        self.value(key, wanted, |value| {
            numbers(value)?.try_into().ok().filter(|n: &[f64; N]| n.iter().all(|n| accept(*n)))
        })
    }

    /// A string that is not empty.
    pub(super) fn text(&mut self, key: &'static str, wanted: &str) -> Option<String> {
        self.value(key, wanted, |value| value.as_str().filter(|text| !text.is_empty()).map(Into::into))
    }

    /// `true` or `false`; `false` where not given.
    pub(super) fn flag(&mut self, key: &'static str) -> bool {
        self.value(key, "`true` or `false`", DeValue::as_bool).unwrap_or(false)
    }

    /// The table `key` through `read`, after which its unknown keys are mistakes.
    pub(super) fn table<T>(
        &mut self,
        key: &'static str,
        read: impl FnOnce(&mut Fields<'_, 'i, '_, 't>) -> T,
    ) -> Option<T> {
        let (start, value) = self.raw(key)?;
        let title = if self.is_root() { format!("[{key}]") } else { format!("{key} of {}", self.title) };
        self.inner(key, title, start, value, read)
    }

    /// The tables of an array through `read`, which gives `None` for a table with mistakes.
    pub(super) fn tables<T>(
        &mut self,
        array: &Tables,
        mut read: impl FnMut(&mut Fields<'_, 'i, '_, 't>) -> Option<T>,
    ) -> Option<Vec<T>> {
        let Tables { key, item, max, wanted } = *array;
        let (_, value) = self.raw(key)?;
        let Some(items) = value.get_ref().as_array().filter(|items| !items.is_empty()) else {
            let found = self.mistakes.excerpt(value);
            self.mistakes.push(value.span().start, format!("`{key}` is `{found}`; wanted {wanted}"));
            return None;
        };
        let read_all: Vec<Option<T>> = (1..=MAX_TABLES)
            .zip(items.iter())
            .map(|(number, value)| {
                let name = format!("{item} {number}");
                let title = format!("{name} of {}", self.title);
                self.inner(&name, title, value.span().start, value, &mut read).flatten()
            })
            .collect();
        if let Some(surplus) = items.get(max) {
            self.mistakes.push(surplus.span().start, format!("`{key}` has {} tables; wanted {wanted}", items.len()));
        }
        read_all.into_iter().collect()
    }

    /// The table `value` inside this one through `read`.
    fn inner<T>(
        &mut self,
        name: &str,
        title: String,
        start: usize,
        value: &Spanned<DeValue<'i>>,
        read: impl FnOnce(&mut Fields<'_, 'i, '_, 't>) -> T,
    ) -> Option<T> {
        let Some(table) = value.get_ref().as_table() else {
            let found = self.mistakes.excerpt(value);
            self.mistakes.push(value.span().start, format!("`{name}` is `{found}`; wanted a table"));
            return None;
        };
        let mut fields = Fields::new(table, title, start, self.mistakes);
        let read = read(&mut fields);
        fields.finish();
        Some(read)
    }

    /// Whether this is the whole manifest, whose tables have titles of their own.
    fn is_root(&self) -> bool {
        self.title == ROOT
    }

    /// Lets every key pass: which ones there are cannot be said.
    pub(super) fn excuse_keys(&mut self) {
        self.are_keys_known = false;
    }

    /// Notes the keys that nobody asked for.
    pub(super) fn finish(self) {
        if !self.are_keys_known {
            return;
        }
        for key in self.table.keys().filter(|key| !self.asked.contains(&key.get_ref().as_ref())) {
            let name = key.get_ref();
            let hint = match closest(name, &self.asked) {
                Some(known) => format!("did you mean `{known}`?"),
                None => format!("wanted one of {}", quoted(&self.asked)),
            };
            let message = format!("unknown key `{}` in `{}`; {hint}", name.escape_debug(), self.title);
            self.mistakes.push(key.span().start, message);
        }
    }
}

/// Names in backquotes, separated by commas.
pub(super) fn quoted(names: &[&str]) -> String {
    names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
}

/// A TOML integer or float as a number; NaN and infinity are none.
pub(super) fn number(value: &DeValue<'_>) -> Option<f64> {
    match value {
        DeValue::Integer(i) => i128::from_str_radix(i.as_str(), i.radix()).ok().map(|i| i as f64),
        DeValue::Float(f) => f.as_str().parse().ok().filter(|f: &f64| f.is_finite()),
        _ => None,
    }
}

/// A TOML integer of at least 0.
pub(super) fn integer(value: &DeValue<'_>) -> Option<u64> {
    value.as_integer().and_then(|i| u64::from_str_radix(i.as_str(), i.radix()).ok())
}

/// An array of numbers.
pub(super) fn numbers(value: &DeValue<'_>) -> Option<Vec<f64>> {
    value.as_array()?.iter().map(|item| number(item.get_ref())).collect()
}

/// The known name nearest to `name`, if it is near enough to be meant: a third of its letters, at least one, differ.
pub(crate) fn closest<'k>(name: &str, known: &[&'k str]) -> Option<&'k str> {
    let name = name.to_lowercase();
    known
        .iter()
        .map(|&k| (edit_distance(&name, k), k))
        .filter(|(distance, k)| *distance <= (k.chars().count() / 3).max(1))
        .min()
        .map(|(_, k)| k)
}

/// Levenshtein's distance: insertions, deletions and replacements that lead from `a` to `b`.
fn edit_distance(a: &str, b: &str) -> usize {
    let mut row: Vec<usize> = (0..=b.chars().count()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, to) in b.chars().enumerate() {
            let replaced = diagonal + usize::from(from != to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row.last().copied().unwrap_or(0)
}
