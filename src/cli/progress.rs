//! What a build tells while it runs: a bar on a terminal, plain lines elsewhere.

use std::collections::BTreeSet;
use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use super::complain;
use crate::build::{Event, Outcome};

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
    /// Surfaces and levels told of.
    told: BTreeSet<(String, usize)>,
}

impl Progress {
    /// Nothing told yet.
    pub(super) fn new(verbosity: Verbosity) -> Self {
        let terminal = std::io::stderr().is_terminal();
        let bar = (terminal && verbosity == Verbosity::Normal).then(|| {
            let bar = ProgressBar::with_draw_target(None, ProgressDrawTarget::stderr());
            let style = ProgressStyle::with_template("[{bar:30}] {pos}/{len} actions  {msg}");
            style.map(|style| bar.with_style(style)).expect("the template is valid")
        });
        Self { bar, verbosity, told: BTreeSet::new() }
    }

    /// Tells what happened.
    pub(super) fn tell(&mut self, event: Event<'_>) {
        match event {
            Event::Stage { name, level, levels, stage } => self.stage(name, level, levels, stage),
            Event::Progress { done, total } => {
                if let Some(bar) = &self.bar {
                    bar.set_length(total as u64);
                    bar.set_position(done as u64);
                }
            }
            Event::Warning { name, text } => self.line("warning", &format!("surface `{name}`: {text}")),
            Event::Notice { text } => self.line("warning", text),
            Event::Failed { name, text } => self.line("error", &format!("surface `{name}`: {text}")),
            Event::VolumeFailed { name, text } => self.line("error", &format!("volume `{name}`: {text}")),
            Event::VolumeWarning { name, text } => self.line("warning", &format!("volume `{name}`: {text}")),
            Event::Ran { .. } | Event::Built { .. } | Event::VolumeBuilt { .. } => {}
        }
    }

    /// Removes the bar, and sums up.
    pub(super) fn finish(&self, outcome: &Outcome) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
        if self.verbosity != Verbosity::Quiet {
            let Outcome { built, current, failed, ran, .. } = outcome;
            let failed = if *failed > 0 { format!(", {failed} failed") } else { String::new() };
            eprintln!("{built} built, {current} up to date{failed}; {ran} actions ran");
        }
    }

    /// A stage begins.
    fn stage(&mut self, name: &str, level: usize, levels: usize, stage: &str) {
        if let Some(bar) = &self.bar {
            bar.set_message(if level == 0 {
                format!("{name}: {stage}")
            } else {
                format!("{name} {level}/{levels}: {stage}")
            });
            return;
        }
        match self.verbosity {
            Verbosity::Quiet => {}
            Verbosity::Normal if level == 0 || !self.told.insert((name.to_owned(), level)) => {}
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
