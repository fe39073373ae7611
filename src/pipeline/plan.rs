//! Which stages a run goes through, and which of them it takes from an earlier run.

use crate::config::Config;
use crate::stages::{ErrorClass, Stage, StageError};

/// What happens to a stage in a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Action {
    /// Its products are made.
    Run,
    /// Its products in the run folder are used.
    Reuse,
}

/// The stages of a run, in order.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Plan {
    /// Each stage with what happens to it.
    pub steps: Vec<(Stage, Action)>,
}

impl Plan {
    /// Plans all stages the pipeline has, up to `until`, or `only` one with its predecessors taken from the run folder.
    ///
    /// # Errors
    /// The pipeline has no table for the stage asked for.
    pub fn new(config: &Config, only: Option<Stage>, until: Option<Stage>) -> Result<Self, StageError> {
        let present = |stage: Stage| match stage {
            Stage::Calibrate => true,
            Stage::Georeference => config.georeference.is_some(),
            Stage::Mosaic => config.mosaic.is_some(),
            Stage::Accuracy => config.accuracy.is_some(),
        };
        if let Some(missing) = only.or(until).filter(|stage| !present(*stage)) {
            let file = config.source.name.display();
            return Err(StageError::new(ErrorClass::Usage, format!("{file} has no table [{missing}]"))
                .help(format!("add a table [{missing}], or ask for another stage")));
        }
        let steps = match only {
            Some(only) => needed_by(only)
                .iter()
                .map(|stage| (*stage, Action::Reuse))
                .chain([(only, Action::Run)])
                .collect(),
            None => Stage::ALL
                .into_iter()
                .filter(|stage| present(*stage) && until.is_none_or(|until| *stage <= until))
                .map(|stage| (stage, Action::Run))
                .collect(),
        };
        Ok(Self { steps })
    }

    /// Whether the stage's products are made in this run.
    pub fn runs(&self, stage: Stage) -> bool {
        self.steps.contains(&(stage, Action::Run))
    }
}

/// The stages whose products a stage reads. Accuracy judges poses, with or without a mosaic.
fn needed_by(stage: Stage) -> &'static [Stage] {
    match stage {
        Stage::Calibrate => &[],
        Stage::Georeference => &[Stage::Calibrate],
        Stage::Mosaic | Stage::Accuracy => &[Stage::Calibrate, Stage::Georeference],
    }
}

/// The stages whose products are made from those of `stage`.
pub(super) fn made_from(stage: Stage) -> impl Iterator<Item = Stage> {
    Stage::ALL.into_iter().filter(move |later| needed_by(*later).contains(&stage))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::execute::tests::pipeline;

    #[test]
    fn all_stages_run_in_order_up_to_the_one_asked_for() {
        let config = pipeline("");
        let steps = |only, until| Plan::new(&config, only, until).unwrap().steps;
        let run = |stages: &[Stage]| stages.iter().map(|stage| (*stage, Action::Run)).collect::<Vec<_>>();
        assert_eq!(steps(None, None), run(&Stage::ALL));
        assert_eq!(steps(None, Some(Stage::Georeference)), run(&[Stage::Calibrate, Stage::Georeference]));
        assert_eq!(
            steps(Some(Stage::Accuracy), None),
            [
                (Stage::Calibrate, Action::Reuse),
                (Stage::Georeference, Action::Reuse),
                (Stage::Accuracy, Action::Run)
            ]
        );
    }

    #[test]
    fn a_stage_the_pipeline_has_not_is_refused() {
        let text = "version = 1\n[calibrate]\ncamera = \"camera.json\"\n";
        let config = Config::from_text(std::path::Path::new("p.toml"), text, &[]).unwrap();
        let error = Plan::new(&config, Some(Stage::Mosaic), None).unwrap_err();
        assert_eq!(error.class(), ErrorClass::Usage);
        assert!(error.to_string().contains("no table [mosaic]"), "{error}");
    }
}
