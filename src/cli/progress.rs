//! What a build tells while it runs: a bar on a terminal, plain lines elsewhere.

use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::complain;
use crate::build::Event;

/// How much is told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verbosity {
    /// Warnings and errors.
    Quiet,
    /// Levels, too.
    Normal,
    /// Stages, too.
    Stages,
}

/// The listener of a build.
pub(super) struct Progress {
    bar: Option<ProgressBar>,
    verbosity: Verbosity,
    /// Surface and level last told of.
    last: (String, usize),
}

impl Progress {
    /// Nothing told yet.
    pub(super) fn new(verbosity: Verbosity) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = (terminal && verbosity == Verbosity::Normal).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            let style = ProgressStyle::with_template("{prefix:20!} [{bar:20}] {pos}/{len} {msg}");
            style.map(|style| bar.with_style(style)).expect("the template is valid")
        });
        Self { bar, verbosity, last: (String::new(), 0) }
    }

    /// Tells what happened.
    pub(super) fn tell(&mut self, event: Event<'_>) {
        match event {
            Event::Stage { name, level, levels, stage } => self.stage(name, level, levels, stage),
            Event::Warning { name, text } => self.line("warning", &format!("surface `{name}`: {text}")),
            Event::Failed { name, text } => self.line("error", &format!("surface `{name}`: {text}")),
            Event::VolumeFailed { name, text } => self.line("error", &format!("volume `{name}`: {text}")),
            Event::VolumeWarning { name, text } => self.line("warning", &format!("volume `{name}`: {text}")),
            Event::Built { .. } | Event::VolumeBuilt { .. } => {}
        }
    }

    /// Removes the bar.
    pub(super) fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }

    /// A stage begins.
    fn stage(&mut self, name: &str, level: usize, levels: usize, stage: &str) {
        if let Some(bar) = &self.bar {
            bar.set_length(levels as u64);
            bar.set_position(level.saturating_sub(1) as u64);
            bar.set_prefix(name.to_owned());
            bar.set_message(stage.to_owned());
            return;
        }
        let new_level = self.last.0 != name || self.last.1 != level;
        self.last = (name.to_owned(), level);
        match self.verbosity {
            Verbosity::Quiet => {}
            Verbosity::Normal if level == 0 || !new_level => {}
            Verbosity::Normal => eprintln!("{name}: level {level} of {levels}"),
            Verbosity::Stages if level == 0 => eprintln!("{name}: {stage}"),
            Verbosity::Stages => eprintln!("{name}: level {level} of {levels}: {stage}"),
        }
    }

    /// A diagnostic that stays.
    fn line(&self, kind: &str, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| complain(kind, text)),
            None => complain(kind, text),
        }
    }
}
