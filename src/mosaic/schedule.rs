//! All tiles of a plan, on all threads of the current pool.

use super::plan::MosaicPlan;
use super::render::{FrameSource, RenderError, TilePixels, render_tile};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Why a mosaic was not finished.
#[derive(Debug, thiserror::Error)]
pub enum ScheduleError<E: std::error::Error + 'static> {
    /// A tile could not be rendered.
    #[error(transparent)]
    Render(RenderError),
    /// A finished tile could not be taken.
    #[error(transparent)]
    Sink(E),
}

/// Renders every tile, passes it through `prepare` on the thread that rendered it, and hands the results to
/// `sink`, one at a time, as they are finished.
///
/// Threads take the tiles in the plan's order ([`MosaicPlan::order`]) but finish them in any: what `sink`
/// makes must not depend on the order. Each thread holds one tile.
///
/// # Errors
/// The first error met; no further tile is begun after it.
pub fn render_all<T, E: std::error::Error + Send + 'static>(
    plan: &MosaicPlan,
    source: &dyn FrameSource,
    prepare: impl Fn(TilePixels) -> T + Sync,
    sink: impl FnMut(T) -> Result<(), E> + Send,
) -> Result<(), ScheduleError<E>> {
    let order = plan.order();
    let next = AtomicUsize::new(0);
    let sink = Mutex::new(sink);
    let failure: Mutex<Option<ScheduleError<E>>> = Mutex::new(None);
    let work = || {
        while let Some(&tile) = order.get(next.fetch_add(1, Ordering::Relaxed)) {
            let done = render_tile(plan, tile, source).map_err(ScheduleError::Render).map(&prepare).and_then(
                |pixels| {
                    let mut sink = sink.lock().unwrap_or_else(|e| e.into_inner());
                    sink(pixels).map_err(ScheduleError::Sink)
                },
            );
            if let Err(error) = done {
                next.store(order.len(), Ordering::Relaxed);
                let mut failure = failure.lock().unwrap_or_else(|e| e.into_inner());
                failure.get_or_insert(error);
            }
        }
    };
    rayon::scope(|scope| {
        for _ in 0..rayon::current_num_threads().min(order.len()) {
            scope.spawn(|_| work());
        }
    });
    match failure.into_inner().unwrap_or_else(|e| e.into_inner()) {
        Some(error) => Err(error),
        None => Ok(()),
    }
}
