//! Actions, what they need, and how far they are.

use std::sync::Arc;

use super::action::{Need, Record, Step};
use super::artifact::Artifact;
use super::explain::Why;
use super::key::{Digest, Field, Walk};

/// Number of an action in its graph. Earlier ones go first, where there is a choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ActionId(usize);

impl ActionId {
    /// The number.
    pub fn index(self) -> usize {
        self.0
    }
}

/// What an action works for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Number of the asset.
    pub asset: usize,
    /// Number of the level, from 1; 0 before the first.
    pub level: usize,
}

/// How far an action is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum State {
    /// It waits for what it needs.
    Wanted,
    /// Its key is known; it waits for its turn.
    Ready,
    /// It runs.
    Running,
    /// An earlier build has made its artifact.
    Cached,
    /// It has run.
    Done,
    /// It could not be done, or something that it needs could not.
    Failed,
}

impl State {
    /// Whether its record is known.
    pub fn is_finished(self) -> bool {
        matches!(self, Self::Cached | Self::Done)
    }
}

/// One action.
#[derive(Debug)]
pub(super) struct Node<S> {
    pub(super) step: Arc<S>,
    pub(super) place: Place,
    pub(super) needs: Vec<ActionId>,
    pub(super) dependents: Vec<ActionId>,
    pub(super) state: State,
    /// Its key with what that was made of, from [`State::Ready`] on.
    pub(super) key: Option<(Digest, Vec<Field>)>,
    /// What is known of its artifact, when it is finished.
    pub(super) record: Option<Arc<Record>>,
    /// Its artifact, while a dependent may want it.
    pub(super) artifact: Option<Arc<Artifact>>,
    /// Set where a stored result is not to be taken.
    pub(super) why: Option<Why>,
    /// Whether its result is what the build is for.
    pub(super) is_goal: bool,
}

/// The actions of a build. An action needs earlier ones only, so there are no cycles.
#[derive(Debug)]
pub struct Graph<S> {
    nodes: Vec<Node<S>>,
}

impl<S> Default for Graph<S> {
    fn default() -> Self {
        Self { nodes: Vec::new() }
    }
}

impl<S: Step> Graph<S> {
    /// Adds an action that needs `needs`.
    pub fn push(&mut self, step: S, place: Place, needs: Vec<ActionId>) -> ActionId {
        let id = ActionId(self.nodes.len());
        needs.iter().for_each(|need| self.nodes[need.0].dependents.push(id));
        self.nodes.push(Node {
            step: Arc::new(step),
            place,
            needs,
            dependents: Vec::new(),
            state: State::Wanted,
            key: None,
            record: None,
            artifact: None,
            why: None,
            is_goal: false,
        });
        id
    }

    /// Makes an action one that the build is for.
    pub fn set_goal(&mut self, id: ActionId) {
        self.nodes[id.0].is_goal = true;
    }

    /// Number of actions.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// All actions.
    pub(super) fn ids(&self) -> impl Iterator<Item = ActionId> + use<S> {
        (0..self.nodes.len()).map(ActionId)
    }

    /// How far an action is.
    pub fn state(&self, id: ActionId) -> State {
        self.nodes[id.0].state
    }

    pub(super) fn node(&self, id: ActionId) -> &Node<S> {
        &self.nodes[id.0]
    }

    pub(super) fn node_mut(&mut self, id: ActionId) -> &mut Node<S> {
        &mut self.nodes[id.0]
    }

    /// Whether everything that an action needs is finished.
    pub(super) fn has_needs(&self, id: ActionId) -> bool {
        self.nodes[id.0].needs.iter().all(|need| self.nodes[need.0].state.is_finished())
    }

    /// The records of what an action needs, all of which is finished.
    pub(super) fn need_records(&self, id: ActionId) -> Vec<Arc<Record>> {
        let record = |need: &ActionId| self.nodes[need.0].record.clone().expect("a finished action has a record");
        self.nodes[id.0].needs.iter().map(record).collect()
    }

    /// What an action needs, with the artifacts that are in memory.
    pub(super) fn needs_of(&self, id: ActionId) -> Vec<Need> {
        let artifact = |need: &ActionId| self.nodes[need.0].artifact.clone();
        let artifacts: Vec<_> = self.nodes[id.0].needs.iter().map(artifact).collect();
        let records = self.need_records(id).into_iter();
        records.zip(artifacts).map(|(record, artifact)| Need { record, artifact }).collect()
    }

    /// The key of an action whose needs are finished, found once.
    pub(super) fn key(&mut self, id: ActionId) -> Digest {
        if let Some((key, _)) = &self.nodes[id.0].key {
            return *key;
        }
        let records = self.need_records(id);
        let node = &mut self.nodes[id.0];
        let mut walk = Walk::new(node.step.stage(), node.step.version());
        node.step.walk(&records, &mut walk);
        let key = walk.key();
        node.key = Some((key, walk.into_fields()));
        key
    }

    /// Bytes of the artifacts in memory.
    pub(super) fn resident_bytes(&self, id: ActionId) -> u64 {
        let node = &self.nodes[id.0];
        node.artifact.as_ref().and(node.record.as_ref()).map_or(0, |record| record.bytes())
    }
}
