//! One run from plan to manifest.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

use super::folder::RunFolder;
use super::inputs;
use super::manifest::{Manifest, REPORT, RESOLVED, StageStatus, Timings, remove_superseded, settings_hash};
use super::plan::{Action, Plan};
use super::timed::Timed;
use crate::config::Config;
use crate::formats::atomic;
use crate::stages::{ErrorClass, Progress, RunContext, Stage, StageError, StageRecord};

/// How a run was asked for.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Run only this stage.
    pub only: Option<Stage>,
    /// Stop after this stage.
    pub until: Option<Stage>,
    /// Take over a run folder of another pipeline, or one of other files.
    pub force: bool,
    /// Run folder instead of the pipeline file's.
    pub output: Option<PathBuf>,
    /// Threads; `None`: one per core.
    pub jobs: Option<usize>,
}

impl RunOptions {
    /// The run folder.
    pub fn folder<'a>(&'a self, config: &'a Config) -> &'a Path {
        self.output.as_deref().unwrap_or(&config.run.output)
    }
}

/// The stages of a pipeline with what they hand to each other.
pub trait Stages {
    /// Makes the stage's products and keeps in memory what later stages need.
    ///
    /// # Errors
    /// Why the stage failed; its earlier products must then still stand.
    fn run(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError>;

    /// Takes from the run folder what later stages need of an earlier run's products.
    ///
    /// # Errors
    /// The products cannot be used.
    fn reuse(&mut self, stage: Stage, config: &Config, context: &RunContext) -> Result<(), StageError>;

    /// Makes the page that shows the whole run, as the bytes of a self-contained HTML file; `None` when there is nothing to show.
    ///
    /// # Errors
    /// Why it cannot be made.
    fn report(
        &mut self,
        config: &Config,
        manifest: &Manifest,
        folder: &Path,
    ) -> Result<Option<Vec<u8>>, StageError>;
}

/// How a run ended.
#[derive(Debug)]
pub enum Outcome {
    /// Declared data is absent; nothing was done. Path and hint of each.
    Skipped(Vec<(PathBuf, String)>),
    /// The products stand in the folder.
    Finished {
        /// The run folder.
        folder: PathBuf,
        /// What is in it.
        manifest: Box<Manifest>,
        /// Set when more frames were rejected than the pipeline file allows.
        exceeded: Option<StageError>,
    },
}

/// Runs a pipeline.
///
/// The manifest is written after every stage, so that it always describes the folder, also when a later stage fails.
///
/// # Errors
/// What stopped the run. Products of stages that had not finished are as they were before.
pub fn execute(
    config: &Config,
    options: &RunOptions,
    stages: &mut (impl Stages + Send),
    progress: &Arc<dyn Progress>,
    interrupted: &Arc<AtomicBool>,
) -> Result<Outcome, StageError> {
    let absent = inputs::absent(config);
    if !absent.is_empty() {
        let absent = absent.into_iter().map(|missing| (missing.path.value.clone(), missing.hint.clone()));
        return Ok(Outcome::Skipped(absent.collect()));
    }
    let plan = Plan::new(config, options.only, options.until)?;
    let jobs = options.jobs.unwrap_or_else(|| std::thread::available_parallelism().map_or(1, usize::from));
    let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build().map_err(|error| {
        StageError::new(ErrorClass::Io, format!("cannot start {jobs} threads"))
            .because(error)
            .help("ask for fewer with --jobs N")
    })?;
    let folder = RunFolder::open(options.folder(config), config, options.force)?;
    pool.install(|| run_plan(config, &plan, &folder, jobs, stages, progress, interrupted))
}

fn run_plan(
    config: &Config,
    plan: &Plan,
    folder: &RunFolder,
    jobs: usize,
    stages: &mut impl Stages,
    progress: &Arc<dyn Progress>,
    interrupted: &Arc<AtomicBool>,
) -> Result<Outcome, StageError> {
    let mut manifest = Manifest::new(config);
    if let Some(earlier) = folder.earlier() {
        manifest.stages = earlier.stages.clone();
        manifest.frames = earlier.frames.clone();
    }
    let timed = Arc::new(Timed::new(progress.clone()));
    let progress: Arc<dyn Progress> = timed.clone();
    let mut timings = Timings { began: jiff::Timestamp::now().to_string(), jobs, ..Timings::default() };
    for (stage, action) in &plan.steps {
        let context =
            RunContext::new(*stage, folder.path(), config.run.seed, progress.clone(), interrupted.clone());
        context.check_interrupted()?;
        match action {
            Action::Reuse => {
                check_reusable(*stage, config, &manifest)?;
                tracing::info!(stage = stage.name(), "{stage}: using the products of an earlier run");
                stages.reuse(*stage, config, &context)?;
            }
            Action::Run => {
                tracing::debug!(stage = stage.name(), "{stage} begins");
                let began = Instant::now();
                stages.run(*stage, config, &context)?;
                let elapsed_s = began.elapsed().as_secs_f64();
                timings.stage_s.insert(*stage, elapsed_s);
                timings.task_s = timed.seconds();
                let record = context.record();
                tracing::info!(stage = stage.name(), elapsed_s, "{stage}: {}", done(&record, elapsed_s));
                remove_superseded(folder.path(), manifest.stages.get(stage), &record);
                manifest.enter(*stage, config, folder.path(), &record)?;
                atomic::write_atomic(&folder.path().join(RESOLVED), config.resolved_toml().as_bytes())?;
                manifest.write(folder.path())?;
                timings.write(folder.path())?;
            }
        }
    }
    if let Some(page) = stages.report(config, &manifest, folder.path())? {
        atomic::write_atomic(&folder.path().join(REPORT), &page)?;
    }
    let exceeded = rejection_limit(config, &manifest);
    Ok(Outcome::Finished { folder: folder.path().to_owned(), manifest: Box::new(manifest), exceeded })
}

/// What a finished stage has done, for the log.
fn done(record: &StageRecord, elapsed_s: f64) -> String {
    let rejected = record.rejected().count();
    let frames = match (record.frames.len(), rejected) {
        (0, _) => String::new(),
        (all, 0) => format!(", {all} frames"),
        (all, rejected) => format!(", {} of {all} frames, {rejected} rejected", all - rejected),
    };
    format!("done in {elapsed_s:.1} s{frames}")
}

/// Whether the products of a stage in the run folder are those its settings would make now.
fn check_reusable(stage: Stage, config: &Config, manifest: &Manifest) -> Result<(), StageError> {
    let refused = |why: &str| {
        let file = config.source.name.display();
        StageError::new(ErrorClass::Usage, format!("the products of {stage} {why}"))
            .help(format!("run it first: boresight run {file} --until {stage}"))
    };
    match manifest.stages.get(&stage) {
        None => Err(refused("are not in the run folder")),
        Some(entry) if entry.settings_blake3 != settings_hash(config, stage) => {
            Err(refused("were made with other settings"))
        }
        Some(entry) if entry.status == StageStatus::Outdated => {
            Err(refused("are older than those they are made from"))
        }
        Some(_) => Ok(()),
    }
}

fn rejection_limit(config: &Config, manifest: &Manifest) -> Option<StageError> {
    let rejected: Vec<_> = manifest.rejected().collect();
    if !config.run.max_rejected_frames.is_exceeded_by(rejected.len()) {
        return None;
    }
    let (frame, reason) = rejected.first()?;
    let (count, of) = (rejected.len(), manifest.frames.len());
    Some(
        StageError::new(
            ErrorClass::Limits,
            format!("{count} of {of} frames were rejected, more than run.max_rejected_frames allows; the first: {frame}: {reason}"),
        )
        .help("the products are complete but for these frames; manifest.json lists all of them")
        .help(format!("to accept this, write max_rejected_frames = {count} (or \"any\") in [run]")),
    )
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::stages::{FrameStatus, NoProgress};

    /// A pipeline with all four stages; `run` is the contents of [run].
    pub(in crate::pipeline) fn pipeline(run: &str) -> Config {
        let text = format!(
            r#"version = 1
[run]
{run}
[calibrate]
camera = "camera.json"
[georeference]
images = "images"
[georeference.log]
file = "log.csv"
join = "name"
[georeference.log.columns]
frame = "file"
latitude = {{ column = "lat", unit = "deg" }}
longitude = {{ column = "lon", unit = "deg" }}
height = {{ column = "h", unit = "m", datum = "ellipsoid" }}
yaw = {{ column = "yaw", unit = "deg", sense = "clockwise_from_true_north" }}
pitch = {{ column = "pitch", unit = "deg", sense = "nose_up" }}
roll = {{ column = "roll", unit = "deg", sense = "right_wing_down" }}
[georeference.mount]
gimbal_elevation = "-90 deg"
[georeference.ground]
kind = "plane"
height = "254.4 m"
datum = "egm96"
[mosaic]
[accuracy.sigmas]
position = {{ cep = "3 m" }}
height = "5 m"
roll = "0.2 deg"
pitch = "0.2 deg"
yaw = "0.6 deg"
"#
        );
        Config::from_text(Path::new("p.toml"), &text, &[]).unwrap()
    }

    /// Stages that write one file each and reject the frame "b.jpg".
    #[derive(Default)]
    struct Pretend {
        seen: Vec<String>,
        fail_at: Option<Stage>,
        product: &'static str,
    }

    impl Stages for Pretend {
        fn run(&mut self, stage: Stage, _: &Config, context: &RunContext) -> Result<(), StageError> {
            if self.fail_at == Some(stage) {
                return Err(StageError::input("bad data"));
            }
            self.seen.push(format!("run {stage}"));
            let name = if self.product.is_empty() { "a.txt" } else { self.product };
            context.write_product(name, stage.name().as_bytes())?;
            if stage == Stage::Georeference {
                context.record_frame("a.jpg", FrameStatus::Used);
                context.record_frame("b.jpg", FrameStatus::Rejected { reason: "no log row".into() });
            }
            Ok(())
        }
        fn reuse(&mut self, stage: Stage, _: &Config, _: &RunContext) -> Result<(), StageError> {
            self.seen.push(format!("reuse {stage}"));
            Ok(())
        }
        fn report(
            &mut self,
            _: &Config,
            manifest: &Manifest,
            _: &Path,
        ) -> Result<Option<Vec<u8>>, StageError> {
            Ok(Some(format!("{} stages", manifest.stages.len()).into_bytes()))
        }
    }

    fn go(
        config: &Config,
        folder: &Path,
        stages: &mut Pretend,
        options: RunOptions,
    ) -> Result<Outcome, StageError> {
        let options = RunOptions { output: Some(folder.to_owned()), jobs: Some(1), ..options };
        let progress: Arc<dyn Progress> = Arc::new(NoProgress);
        execute(config, &options, stages, &progress, &Arc::default())
    }

    fn finished(outcome: Result<Outcome, StageError>) -> (Manifest, Option<StageError>) {
        match outcome.unwrap() {
            Outcome::Finished { manifest, exceeded, .. } => (*manifest, exceeded),
            Outcome::Skipped(_) => panic!("skipped"),
        }
    }

    fn text(path: PathBuf) -> String {
        std::fs::read_to_string(path).unwrap()
    }

    #[test]
    fn a_run_leaves_products_report_manifest_and_resolved_settings() {
        let folder = tempfile::tempdir().unwrap();
        let mut stages = Pretend::default();
        let (manifest, exceeded) = finished(go(
            &pipeline("max_rejected_frames = 1"),
            folder.path(),
            &mut stages,
            RunOptions::default(),
        ));
        assert!(exceeded.is_none());
        assert_eq!(stages.seen, ["run calibrate", "run georeference", "run mosaic", "run accuracy"]);
        assert_eq!(text(folder.path().join("mosaic/a.txt")), "mosaic");
        assert_eq!(text(folder.path().join("index.html")), "4 stages");
        assert!(text(folder.path().join("resolved.toml")).contains("max_rejected_frames = 1"));
        assert_eq!(Manifest::read(folder.path()).unwrap().unwrap(), manifest);
        let product = &manifest.stages[&Stage::Mosaic].products[0];
        assert_eq!((product.path.as_str(), product.bytes), ("mosaic/a.txt", 6));
        assert_eq!(product.blake3, blake3::hash(b"mosaic").to_hex().to_string());
        assert_eq!(manifest.rejected().collect::<Vec<_>>(), [("b.jpg", "no log row")]);
        assert_eq!(manifest.frames["b.jpg"].rejected_by, Some(Stage::Georeference));
    }

    #[test]
    fn the_manifest_is_the_same_bytes_again_and_names_no_absolute_path() {
        let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        for folder in [&first, &second] {
            finished(go(&pipeline(""), folder.path(), &mut Pretend::default(), RunOptions::default()));
        }
        let manifest = text(first.path().join("manifest.json"));
        assert_eq!(manifest, text(second.path().join("manifest.json")));
        assert!(!manifest.contains(&first.path().display().to_string()));
    }

    #[test]
    fn too_many_rejected_frames_are_reported_after_the_products_are_made() {
        let folder = tempfile::tempdir().unwrap();
        let (_, exceeded) =
            finished(go(&pipeline(""), folder.path(), &mut Pretend::default(), RunOptions::default()));
        let exceeded = exceeded.unwrap();
        assert_eq!(exceeded.class(), ErrorClass::Limits);
        assert!(exceeded.to_string().contains("1 of 2 frames were rejected"), "{exceeded}");
        assert!(folder.path().join("accuracy/a.txt").exists());
        let any = pipeline("max_rejected_frames = \"any\"");
        let (_, exceeded) = finished(go(&any, folder.path(), &mut Pretend::default(), RunOptions::default()));
        assert!(exceeded.is_none());
    }

    #[test]
    fn one_stage_reuses_what_stands_and_outdates_what_follows() {
        let folder = tempfile::tempdir().unwrap();
        let config = pipeline("");
        let only = |stage| RunOptions { only: Some(stage), ..RunOptions::default() };
        let error = go(&config, folder.path(), &mut Pretend::default(), only(Stage::Mosaic)).unwrap_err();
        assert!(error.to_string().contains("calibrate are not in the run folder"), "{error}");
        assert!(error.helps()[0].contains("--until calibrate"), "{:?}", error.helps());
        finished(go(&config, folder.path(), &mut Pretend::default(), RunOptions::default()));
        let mut stages = Pretend::default();
        let (manifest, _) = finished(go(&config, folder.path(), &mut stages, only(Stage::Georeference)));
        assert_eq!(stages.seen, ["reuse calibrate", "run georeference"]);
        assert_eq!(manifest.stages[&Stage::Mosaic].status, StageStatus::Outdated);
        assert_eq!(manifest.stages[&Stage::Calibrate].status, StageStatus::Done);
        let other = pipeline("seed = 5");
        let error = go(&other, folder.path(), &mut Pretend::default(), only(Stage::Mosaic)).unwrap_err();
        assert!(error.to_string().contains("made with other settings"), "{error}");
    }

    #[test]
    fn a_failed_stage_leaves_earlier_products_and_a_true_manifest() {
        let folder = tempfile::tempdir().unwrap();
        let config = pipeline("");
        finished(go(&config, folder.path(), &mut Pretend::default(), RunOptions::default()));
        let mut stages = Pretend { fail_at: Some(Stage::Mosaic), ..Pretend::default() };
        assert!(go(&config, folder.path(), &mut stages, RunOptions::default()).is_err());
        assert_eq!(text(folder.path().join("mosaic/a.txt")), "mosaic");
        let manifest = Manifest::read(folder.path()).unwrap().unwrap();
        assert_eq!(manifest.stages[&Stage::Mosaic].status, StageStatus::Outdated);
    }

    #[test]
    fn products_of_an_earlier_run_that_are_not_made_again_go() {
        let folder = tempfile::tempdir().unwrap();
        finished(go(&pipeline(""), folder.path(), &mut Pretend::default(), RunOptions::default()));
        let mut stages = Pretend { product: "b.txt", ..Pretend::default() };
        finished(go(&pipeline(""), folder.path(), &mut stages, RunOptions::default()));
        assert!(!folder.path().join("mosaic/a.txt").exists());
        assert!(folder.path().join("mosaic/b.txt").exists());
    }

    #[test]
    fn absent_data_skips_the_run_and_writes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let output = folder.path().join("out");
        let config = pipeline("requires = [{ path = \"no/such/data\", hint = \"the survey\" }]");
        let outcome = go(&config, &output, &mut Pretend::default(), RunOptions::default()).unwrap();
        let Outcome::Skipped(absent) = outcome else { panic!("ran") };
        assert_eq!(absent, [(PathBuf::from("no/such/data"), "the survey".to_owned())]);
        assert!(!output.exists());
    }

    #[test]
    fn a_request_to_stop_ends_the_run_between_stages() {
        let folder = tempfile::tempdir().unwrap();
        let options = RunOptions { output: Some(folder.path().to_owned()), ..RunOptions::default() };
        let progress: Arc<dyn Progress> = Arc::new(NoProgress);
        let stop = Arc::new(AtomicBool::new(true));
        let error = execute(&pipeline(""), &options, &mut Pretend::default(), &progress, &stop).unwrap_err();
        assert_eq!(error.class(), ErrorClass::Interrupted);
    }
}
