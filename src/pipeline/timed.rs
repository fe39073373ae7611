//! How long each piece of work took, measured where the user sees it begin and end.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use crate::stages::{Progress, Stage, TaskProgress};

/// Wall seconds by stage and piece of work.
pub type TaskSeconds = BTreeMap<Stage, BTreeMap<String, f64>>;

/// Passes progress on and notes how long every piece of work took.
pub struct Timed {
    shown: Arc<dyn Progress>,
    seconds: Arc<Mutex<TaskSeconds>>,
}

impl Timed {
    /// Around what shows the progress.
    pub fn new(shown: Arc<dyn Progress>) -> Self {
        Self { shown, seconds: Arc::default() }
    }

    /// What has ended so far; pieces of the same name are added up.
    pub fn seconds(&self) -> TaskSeconds {
        self.seconds.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Progress for Timed {
    fn begin(&self, stage: Stage, label: &str, total: u64) -> Box<dyn TaskProgress> {
        Box::new(TimedTask {
            shown: self.shown.begin(stage, label, total),
            stage,
            label: label.to_owned(),
            began: Instant::now(),
            seconds: self.seconds.clone(),
        })
    }
}

struct TimedTask {
    shown: Box<dyn TaskProgress>,
    stage: Stage,
    label: String,
    began: Instant,
    seconds: Arc<Mutex<TaskSeconds>>,
}

impl TaskProgress for TimedTask {
    fn advance(&self, steps: u64) {
        self.shown.advance(steps);
    }
}

impl Drop for TimedTask {
    fn drop(&mut self) {
        let mut seconds = self.seconds.lock().unwrap_or_else(PoisonError::into_inner);
        *seconds.entry(self.stage).or_default().entry(std::mem::take(&mut self.label)).or_default() +=
            self.began.elapsed().as_secs_f64();
    }
}
