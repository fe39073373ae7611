//! Everything on stderr: messages, progress, errors; as lines for people or JSON lines for programs.

use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use indicatif::{MultiProgress, ProgressBar, ProgressDrawTarget, ProgressStyle};
use serde_json::{Map, Value, json};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Subscriber};
use tracing_subscriber::layer::{Context, Layer, SubscriberExt};
use tracing_subscriber::registry::LookupSpan;

use super::args::{Colour, LogFormat, Talk};
use super::exit::ExitClass;
use crate::config::Diagnostic;
use crate::stages::{Progress, Stage, StageError, TaskProgress};

/// The user's end of stderr.
#[derive(Debug)]
pub struct Console {
    format: LogFormat,
    level: Level,
    colour: bool,
    /// Where bars are drawn; absent when stderr is no terminal.
    bars: Option<MultiProgress>,
}

impl Console {
    /// Decides form, colour and bars from the arguments and what stderr is.
    pub fn new(talk: &Talk) -> Arc<Self> {
        let terminal = std::io::stderr().is_terminal();
        let level = match (talk.quiet, talk.verbose) {
            (true, _) => Level::ERROR,
            (_, true) => Level::DEBUG,
            _ => Level::INFO,
        };
        let plain = talk.log == LogFormat::Text;
        let colour = plain
            && match talk.color {
                Colour::Always => true,
                Colour::Never => false,
                // https://no-color.org: any value but the empty one.
                Colour::Auto => terminal && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty()),
            };
        let bars = (plain && terminal && !talk.quiet)
            .then(|| MultiProgress::with_draw_target(ProgressDrawTarget::stderr()));
        Arc::new(Self { format: talk.log, level, colour, bars })
    }

    /// Routes the program's messages here.
    pub fn receive_messages(self: &Arc<Self>) {
        let subscriber = tracing_subscriber::registry().with(Messages(self.clone()));
        // Fails only when messages are routed already, by a test in the same process.
        let _ = tracing::subscriber::set_global_default(subscriber);
    }

    /// Prints an error with its place, causes and help.
    pub fn error(&self, error: &StageError) {
        let class = error.class().name();
        let causes = causes(error);
        match self.format {
            LogFormat::Text => {
                let diagnostic = Diagnostic {
                    message: error.to_string(),
                    place: error.place().cloned(),
                    help: error.helps().to_vec(),
                };
                self.line(&diagnostic.render(class, &causes, self.colour));
            }
            LogFormat::Json => {
                let place = error.place();
                self.json(json!({
                    "level": "error",
                    "class": class,
                    "exit_code": ExitClass::from(error.class()) as u8,
                    "message": error.to_string(),
                    "place": place.map(ToString::to_string),
                    "line": place.map(|place| place.source.line_and_column(&place.span).0),
                    "column": place.map(|place| place.source.line_and_column(&place.span).1),
                    "causes": causes,
                    "help": error.helps(),
                }));
            }
        }
    }

    /// One line above any progress bars.
    pub fn line(&self, text: &str) {
        // Nobody is left to tell when stderr itself is gone.
        let print = || drop(writeln!(std::io::stderr().lock(), "{text}"));
        match &self.bars {
            Some(bars) => bars.suspend(print),
            None => print(),
        }
    }

    fn json(&self, object: Value) {
        self.line(&object.to_string());
    }
}

/// The chain under an error, outermost first, without what the error's own text repeats.
fn causes(error: &dyn std::error::Error) -> Vec<String> {
    let mut causes = Vec::new();
    let mut next = error.source();
    while let Some(cause) = next {
        causes.push(cause.to_string());
        next = cause.source();
    }
    causes
}

/// Hands tracing's events to the console.
struct Messages(Arc<Console>);

impl<S: Subscriber + for<'a> LookupSpan<'a>> Layer<S> for Messages {
    fn on_event(&self, event: &Event<'_>, _: Context<'_, S>) {
        let metadata = event.metadata();
        if *metadata.level() > self.0.level || !metadata.target().starts_with("boresight") {
            return;
        }
        let mut fields = Fields::default();
        event.record(&mut fields);
        let level = metadata.level().as_str().to_lowercase();
        match self.0.format {
            LogFormat::Json => {
                let mut object = Map::new();
                object.insert("level".into(), level.into());
                object.insert("message".into(), fields.message.into());
                object.extend(fields.others);
                self.0.json(Value::Object(object));
            }
            LogFormat::Text => {
                let prefix = match *metadata.level() {
                    Level::INFO => String::new(),
                    Level::WARN if self.0.colour => "\u{1b}[1;33mwarning\u{1b}[0m: ".to_owned(),
                    Level::WARN => "warning: ".to_owned(),
                    _ => format!("{level}: "),
                };
                self.0.line(&format!("{prefix}{}", fields.message));
            }
        }
    }
}

/// An event's message and its other fields.
#[derive(Default)]
struct Fields {
    message: String,
    others: Map<String, Value>,
}

impl Fields {
    fn put(&mut self, field: &Field, value: Value) {
        match (field.name(), value) {
            ("message", Value::String(text)) => self.message = text,
            (name, value) => {
                self.others.insert(name.to_owned(), value);
            }
        }
    }
}

impl Visit for Fields {
    fn record_str(&mut self, field: &Field, value: &str) {
        self.put(field, value.into());
    }
    fn record_u64(&mut self, field: &Field, value: u64) {
        self.put(field, value.into());
    }
    fn record_i64(&mut self, field: &Field, value: i64) {
        self.put(field, value.into());
    }
    fn record_f64(&mut self, field: &Field, value: f64) {
        self.put(field, json!(value));
    }
    fn record_debug(&mut self, field: &Field, value: &dyn std::fmt::Debug) {
        self.put(field, format!("{value:?}").into());
    }
}

impl Console {
    /// Progress of work that is no stage's.
    pub fn count(&self, who: &'static str, label: &str, total: usize) -> Box<dyn TaskProgress> {
        self.begin_task(who, label, total as u64)
    }

    fn begin_task(&self, who: &'static str, label: &str, total: u64) -> Box<dyn TaskProgress> {
        match (self.format, &self.bars) {
            (LogFormat::Json, _) if self.level >= Level::INFO => Box::new(JsonTask::begin(who, label, total)),
            (LogFormat::Text, Some(bars)) => {
                let style =
                    ProgressStyle::with_template("{prefix:>12} {msg} [{bar:30}] {pos}/{len} {eta} left")
                        .expect("a constant template")
                        .progress_chars("=> ");
                let bar =
                    ProgressBar::new(total).with_style(style).with_prefix(who).with_message(label.to_owned());
                let bar = bars.add(bar);
                bar.enable_steady_tick(Duration::from_millis(250));
                Box::new(BarTask(bar))
            }
            _ => Box::new(crate::stages::NoProgress),
        }
    }
}

impl Progress for Console {
    fn begin(&self, stage: Stage, label: &str, total: u64) -> Box<dyn TaskProgress> {
        self.begin_task(stage.name(), label, total)
    }
}

struct BarTask(ProgressBar);

impl TaskProgress for BarTask {
    fn advance(&self, steps: u64) {
        self.0.inc(steps);
    }
}

impl Drop for BarTask {
    fn drop(&mut self) {
        self.0.finish_and_clear();
    }
}

/// Progress as JSON lines, at most five a second.
struct JsonTask {
    who: &'static str,
    label: String,
    total: u64,
    done: AtomicU64,
    last: Mutex<Instant>,
}

const JSON_INTERVAL: Duration = Duration::from_millis(200);

impl JsonTask {
    fn begin(who: &'static str, label: &str, total: u64) -> Self {
        let task = Self {
            who,
            label: label.to_owned(),
            total,
            done: AtomicU64::new(0),
            last: Mutex::new(Instant::now()),
        };
        task.say(0);
        task
    }

    fn say(&self, done: u64) {
        let object = json!({
            "level": "info", "event": "progress", "stage": self.who, "task": self.label,
            "done": done, "total": self.total,
        });
        drop(writeln!(std::io::stderr().lock(), "{object}"));
    }
}

impl TaskProgress for JsonTask {
    fn advance(&self, steps: u64) {
        let done = self.done.fetch_add(steps, Ordering::Relaxed) + steps;
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if last.elapsed() >= JSON_INTERVAL {
            *last = Instant::now();
            self.say(done);
        }
    }
}

impl Drop for JsonTask {
    fn drop(&mut self) {
        self.say(self.done.load(Ordering::Relaxed));
    }
}
