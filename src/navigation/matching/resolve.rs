//! From times to accepted pairs: check, search, refine, weigh the hypotheses against each other, decide.

use super::fit::{Mode, Prior, log_posterior, refine};
use super::model::{Edge, Hypothesis, Series, Sums};
use super::votes::guesses;
use super::{
    ClockFit, ClockPrior, MatchError, MatchOptions, Matching, Pair, PhotoReason, PhotoTime, Recording,
    RunnerUp, TriggerReason,
};
use crate::units::Seconds;
use rayon::prelude::*;

/// Photos, and triggers, at most.
const MOST: usize = 100_000;
/// Photos with a time, and triggers, at least, when the offset is unknown.
const LEAST: usize = 4;
/// Guesses that are refined.
const REFINED: usize = 10;
/// An alignment is accepted when all distinctly different ones together are this unlikely.
const OTHERS: f64 = 1e-3;
/// Beyond the edge of time: no clock counts so far (30,000 years of seconds, and f64 still resolves 0.1 ms).
const FARTHEST_S: f64 = 1e12;
/// Triggers closer than so many steps of the photos' times are not told apart one by one.
const SLIPPERY: f64 = 1.2;
/// One sigma of a shutter's delay between two series on the same clock.
const SAME_STD: f64 = 0.15;
/// Clocks that are both disciplined by GPS do not drift by more.
const SAME_DRIFT: f64 = 2e-6;

/// The given series, cleaned; indices lead back.
struct Given {
    series: Series,
    /// Index of each timed photo as given.
    photo_index: Vec<usize>,
    photo_origin: f64,
    trigger_origin: f64,
    out_of_order: usize,
    /// Photos of one instant whose order is unknown.
    unsure: Vec<bool>,
}

pub(super) fn resolve(
    photos: &[PhotoTime],
    triggers: &[Seconds],
    options: &MatchOptions,
) -> Result<Matching, MatchError> {
    let given = check(photos, triggers, options)?;
    let resolution = 2.0 * given.series.halves.iter().copied().fold(0.0, f64::max);
    // Pairs and offset would hold each other in place, right or wrong.
    if options.clock == ClockPrior::Unknown && given.series.interval < SLIPPERY * resolution {
        return Err(too_coarse(&given.series));
    }
    let prior = prior(photos, triggers, options, &given)?;
    let modes = modes(&given.series, &prior)?;
    decide(photos, triggers, options, &given, &prior, &modes)
}

fn check(photos: &[PhotoTime], triggers: &[Seconds], options: &MatchOptions) -> Result<Given, MatchError> {
    if !(0.0..=100_000.0).contains(&options.drift_limit_ppm) {
        return Err(MatchError::Option(format!(
            "a drift limit of {} ppm is not one from 0 to 100000",
            options.drift_limit_ppm
        )));
    }
    if !(0.5..1.0).contains(&options.level) {
        return Err(MatchError::Option(format!("a level of {} is not one from 0.5 to 1", options.level)));
    }
    for (count, what) in [(photos.len(), "photos"), (triggers.len(), "triggers")] {
        if count > MOST {
            return Err(MatchError::TooMany { count, what, most: MOST });
        }
    }
    check_triggers(triggers)?;
    let mut timed = check_photos(photos)?;
    let least = if options.clock == ClockPrior::Unknown { LEAST } else { 1 };
    if timed.len() < least || triggers.len() < least {
        return Err(MatchError::TooFew { photos: timed.len(), triggers: triggers.len(), least });
    }
    let out_of_order = timed.windows(2).filter(|w| w[1].1 < w[0].1).count();
    // One step back is a counter that wrapped: the file order then starts after it.
    if out_of_order == 1
        && let Some(seam) = timed.windows(2).position(|w| w[1].1 < w[0].1)
    {
        timed.rotate_left(seam + 1);
    }
    // Stable: photos of the same second keep their order.
    timed.sort_by(|a, b| a.1.total_cmp(&b.1));
    let unsure = unsure_ties(&timed, out_of_order);
    let (first, last) = (timed[0].1, timed[timed.len() - 1].1);
    let (start, end) = (triggers[0].get(), triggers[triggers.len() - 1].get());
    let photo_origin = 0.5 * (first + last);
    let trigger_origin = 0.5 * (start + end);
    let mut gaps: Vec<f64> = triggers.windows(2).map(|w| (w[1] - w[0]).get()).collect();
    gaps.sort_by(f64::total_cmp);
    let interval = gaps.get(gaps.len() / 2).copied().unwrap_or(1.0);
    Ok(Given {
        series: Series {
            photos: timed.iter().map(|(_, t)| t - photo_origin).collect(),
            halves: timed.iter().map(|(i, _)| photos[*i].resolution.get() / 2.0).collect(),
            triggers: triggers.iter().map(|s| s.get() - trigger_origin).collect(),
            interval,
            span: (last - first).max(end - start).max(interval),
        },
        photo_index: timed.iter().map(|(i, _)| *i).collect(),
        photo_origin,
        trigger_origin,
        out_of_order,
        unsure,
    })
}

/// Photos of one instant that do not stand together in a file order that time does not follow: nothing says which of
/// them came first.
fn unsure_ties(timed: &[(usize, f64)], out_of_order: usize) -> Vec<bool> {
    let mut unsure = vec![false; timed.len()];
    if out_of_order > 1 {
        for i in 1..timed.len() {
            if timed[i].1 == timed[i - 1].1 && timed[i].0 != timed[i - 1].0 + 1 {
                (unsure[i - 1], unsure[i]) = (true, true);
            }
        }
    }
    unsure
}

fn check_triggers(triggers: &[Seconds]) -> Result<(), MatchError> {
    let bad = |index, cause| Err(MatchError::Trigger { index, cause });
    for (index, s) in triggers.iter().enumerate() {
        if !(-FARTHEST_S..=FARTHEST_S).contains(&s.get()) {
            return bad(index, format!("{} s is no time", s.get()));
        }
        // Neither is a NaN: the range above holds none.
        if index > 0 && s.get() <= triggers[index - 1].get() {
            return bad(
                index,
                format!(
                    "{} s does not come after {} s of the trigger before it",
                    s.get(),
                    triggers[index - 1].get()
                ),
            );
        }
    }
    Ok(())
}

/// Index and middle of the interval that its time stands for, for each photo with a time.
fn check_photos(photos: &[PhotoTime]) -> Result<Vec<(usize, f64)>, MatchError> {
    let bad = |index, cause| Err(MatchError::Photo { index, cause });
    let mut timed = Vec::with_capacity(photos.len());
    for (index, photo) in photos.iter().enumerate() {
        let Some(time) = photo.time else { continue };
        if !(-FARTHEST_S..=FARTHEST_S).contains(&time.get()) {
            return bad(index, format!("{} s is no time", time.get()));
        }
        if !(0.0..=60.0).contains(&photo.resolution.get()) {
            return bad(
                index,
                format!("a resolution of {} s is not one from 0 to 60 s", photo.resolution.get()),
            );
        }
        timed.push((index, time.get() + photo.resolution.get() / 2.0));
    }
    Ok(timed)
}

fn prior(
    photos: &[PhotoTime],
    triggers: &[Seconds],
    options: &MatchOptions,
    given: &Given,
) -> Result<Prior, MatchError> {
    let to_middle = given.photo_origin - given.trigger_origin;
    let widest = given.series.halves.iter().copied().fold(0.0, f64::max);
    let limit = options.drift_limit_ppm * 1e-6;
    let known = |offset: f64, std: f64, drift_limit: f64| Prior {
        // A rounding camera's middles lie half a resolution earlier.
        offset: Some((offset + to_middle - widest, offset + to_middle, std.max(1e-3))),
        drift_limit,
    };
    match options.clock {
        ClockPrior::Unknown => Ok(Prior { offset: None, drift_limit: limit }),
        ClockPrior::Same => Ok(known(0.0, SAME_STD, limit.min(SAME_DRIFT))),
        ClockPrior::Known { offset, std } => {
            if !(offset.get().abs() <= FARTHEST_S && (0.0..=FARTHEST_S).contains(&std.get())) {
                return Err(MatchError::Option(format!(
                    "a clock offset of {} s ± {} s is none",
                    offset.get(),
                    std.get()
                )));
            }
            Ok(known(offset.get(), std.get(), limit))
        }
        ClockPrior::Anchor { photo, trigger } => {
            let time = photos.get(photo).and_then(|p| p.time).ok_or_else(|| {
                MatchError::Option(format!(
                    "photo {} is named as known, but there is none with a time",
                    photo + 1
                ))
            })?;
            let Some(at) = triggers.get(trigger) else {
                return Err(MatchError::Option(format!(
                    "trigger {} is named as known, but there are {}",
                    trigger + 1,
                    triggers.len()
                )));
            };
            let resolution = photos[photo].resolution.get();
            let offset = (*at - time).get() - resolution / 2.0 + to_middle;
            // The offset at the log's middle differs by the drift in between.
            let slack = 0.1 + limit * given.series.triggers[trigger].abs();
            Ok(Prior {
                offset: Some((offset - resolution / 2.0, offset + resolution / 2.0, slack)),
                drift_limit: limit,
            })
        }
    }
}

/// The hypotheses that survive refinement, heaviest first, none twice.
fn modes(series: &Series, prior: &Prior) -> Result<Vec<Mode>, MatchError> {
    let (mut starts, width) = guesses(series, prior);
    if let Some((low, high, _)) = prior.offset {
        starts.push(super::votes::Guess { pivot: -0.5 * (low + high), drift: 0.0 });
    }
    let scale = (width / 4.0).min(series.interval / 3.0).max(0.002);
    let mut ranked: Vec<(f64, Hypothesis)> = starts
        .iter()
        .filter_map(|g| {
            let h = Hypothesis {
                pivot: g.pivot,
                at_pivot: 0.0,
                drift: g.drift,
                scale,
                misfire: 0.05,
                extra_rate: 0.05 / series.interval,
            };
            Sums::new(series, &h).map(|sums| (log_posterior(&sums, &h, prior), h))
        })
        .collect();
    if ranked.is_empty() {
        return Err(too_coarse(series));
    }
    ranked.sort_by(|a, b| b.0.total_cmp(&a.0));
    let log_range = match prior.offset {
        None => (2.0 * series.span).max(1.0).ln(),
        Some((low, high, std)) => (high - low + 2.5 * std).ln(),
    };
    let mut modes: Vec<Mode> = Vec::new();
    let refined: Vec<Option<Mode>> =
        ranked.into_par_iter().take(REFINED).map(|(_, h)| refine(series, h, prior, log_range)).collect();
    for mode in refined {
        insert(&mut modes, mode.ok_or_else(|| too_coarse(series))?, series);
    }
    // The classic mistakes: all photos one, two or three triggers early or late.
    let best = modes[0].hypothesis;
    let choices = modes[0].choices(series.photos.len());
    let shifted: Vec<Option<Mode>> = [-3_isize, -2, -1, 1, 2, 3]
        .into_par_iter()
        .filter_map(|by| shifted(series, &best, &choices, by))
        // Many shifts were among the guesses.
        .filter(|h| !modes.iter().any(|m| (m.hypothesis.predict(h.pivot) - h.at_pivot).abs() < 0.02))
        .map(|h| refine(series, h, prior, log_range))
        .collect();
    for mode in shifted.into_iter().flatten() {
        insert(&mut modes, mode, series);
    }
    Ok(modes)
}

fn too_coarse(series: &Series) -> MatchError {
    MatchError::TooCoarse {
        resolution_s: 2.0 * series.halves.iter().copied().fold(0.0, f64::max),
        interval_s: series.interval,
    }
}

/// Keeps the heavier of two modes with the same pairs, and the order by weight.
fn insert(modes: &mut Vec<Mode>, mode: Mode, series: &Series) {
    let n = series.photos.len();
    let choices = mode.choices(n);
    if let Some(same) = modes.iter_mut().find(|m| m.choices(n) == choices) {
        if mode.log_weight > same.log_weight {
            *same = mode;
        }
    } else {
        modes.push(mode);
    }
    modes.sort_by(|a, b| b.log_weight.total_cmp(&a.log_weight));
}

/// The hypothesis moved by the median of what its pairs' triggers are from their `by`-th neighbours.
fn shifted(series: &Series, h: &Hypothesis, choices: &[Option<usize>], by: isize) -> Option<Hypothesis> {
    let mut moves: Vec<f64> = choices
        .iter()
        .flatten()
        .filter_map(|j| {
            let other = series.triggers.get(j.checked_add_signed(by)?)?;
            Some(other - series.triggers[*j])
        })
        .collect();
    if moves.is_empty() {
        return None;
    }
    moves.sort_by(f64::total_cmp);
    let middle = moves[moves.len() / 2];
    Some(Hypothesis { at_pivot: h.at_pivot + middle, scale: h.scale.max(0.02), ..*h })
}

/// Logarithm of the weight of "nothing belongs together".
fn log_nothing(series: &Series) -> f64 {
    let n = series.photos.len() as f64;
    let rate = (n + 0.5) / (series.span + 10.0 * series.interval);
    n * rate.ln() - rate * series.span
}

/// True when most photos have the same trigger in both.
fn alike(a: &[Option<usize>], b: &[Option<usize>]) -> bool {
    let either = a.iter().zip(b).filter(|(x, y)| x.is_some() || y.is_some()).count();
    let same = a.iter().zip(b).filter(|(x, y)| x.is_some() && x == y).count();
    10 * same >= 9 * either
}

fn decide(
    photos: &[PhotoTime],
    triggers: &[Seconds],
    options: &MatchOptions,
    given: &Given,
    prior: &Prior,
    modes: &[Mode],
) -> Result<Matching, MatchError> {
    let series = &given.series;
    let n = series.photos.len();
    let best = &modes[0];
    let choices = best.choices(n);
    let (kin, others): (Vec<&Mode>, Vec<&Mode>) = modes.iter().partition(|m| alike(&m.choices(n), &choices));
    let heaviest = best.log_weight.max(log_nothing(series));
    let weight = |m: &&Mode| (m.log_weight - heaviest).exp();
    let ours: f64 = kin.iter().map(weight).sum();
    let total = ours + others.iter().map(weight).sum::<f64>() + (log_nothing(series) - heaviest).exp();
    let probability = ours / total;
    let decisions: Vec<Decided> = others.iter().map(|o| decided(series, best, o)).collect();
    // The one that nothing decides against, or else the next in weight.
    let undecided = decisions.iter().position(|d| *d == Decided::No);
    let runner_up = others.get(undecided.unwrap_or(0)).map(|o| RunnerUp {
        shift: Seconds::new(offset_of(&o.hypothesis, best.hypothesis.pivot) - offset_at_pivot(best)),
        pairs: o.pairs().round() as usize,
        log_ratio: best.log_weight - o.log_weight,
    });
    let clock = clock(options, given, prior, best);
    let found = choices.iter().flatten().count();
    let within = photos_within(series, &best.hypothesis);
    if best.log_weight < log_nothing(series) || 2 * found < within || found == 0 {
        return Err(MatchError::Unrelated { pairs: found, photos: within, triggers: triggers.len() });
    }
    if probability.is_nan() || probability < 1.0 - OTHERS || undecided.is_some() {
        return Err(MatchError::Ambiguous {
            offset_s: clock.offset.get(),
            pairs: found,
            probability,
            shift_s: runner_up.map_or(0.0, |r| r.shift.get()),
            other_pairs: runner_up.map_or(0, |r| r.pairs),
        });
    }
    let table = mixture(series, prior, &kin);
    let mut matching = Matching {
        pairs: Vec::new(),
        unmatched_photos: Vec::new(),
        unmatched_triggers: Vec::new(),
        clock,
        probability,
        runner_up,
        rests_on_count: decisions.contains(&Decided::ByCount),
        out_of_order: given.out_of_order,
    };
    accept(photos, triggers, options, given, &table, &mut matching);
    Ok(matching)
}

/// Number of breaks between triggers at which a shift by one loses a pair for certain: no whole number of the
/// intervals around them (that may be missing events), and too long for the photos' resolution to bridge.
fn turns(series: &Series) -> f64 {
    let resolution = 2.0 * series.halves.iter().copied().fold(0.0, f64::max);
    // Photos of one instant slip from trigger to trigger without a loss.
    if series.interval < SLIPPERY * resolution {
        return 0.0;
    }
    let gaps: Vec<f64> = series.triggers.windows(2).map(|w| w[1] - w[0]).collect();
    let bridged = 0.5 + resolution;
    let turn = |(i, gap): (usize, &f64)| {
        let mut around = gaps[i.saturating_sub(4)..(i + 5).min(gaps.len())].to_vec();
        around.sort_by(f64::total_cmp);
        let interval = around[around.len() / 2].max(1e-9);
        let ratio = gap / interval;
        gap - interval > bridged && (ratio > 10.0 || (ratio - ratio.round()).abs() > 0.25)
    };
    gaps.iter().enumerate().filter(|g| turn(*g)).count() as f64
}

fn offset_of(h: &Hypothesis, photo: f64) -> f64 {
    h.predict(photo) - photo
}

fn offset_at_pivot(mode: &Mode) -> f64 {
    offset_of(&mode.hypothesis, mode.hypothesis.pivot)
}

/// Photos that the hypothesis places between the first and the last trigger.
fn photos_within(series: &Series, h: &Hypothesis) -> usize {
    let (first, last) = (series.triggers[0], series.triggers[series.triggers.len() - 1]);
    series.photos.iter().filter(|t| (first..=last).contains(&h.predict(**t))).count()
}

/// What decides between the best alignment and another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Decided {
    /// Residuals, or the places of the gaps.
    ByTimes,
    /// Only that there are as many photos as triggers, and none lacks its partner.
    ByCount,
    /// Nothing that chance could not do as well.
    No,
}

/// The probabilities alone would trust too much in gaps that coincide: with evenly spaced triggers, misfires and
/// missing events leave holes in both series, and some shift brings two holes together by chance. So a number of pairs
/// counts only when it exceeds what such chances give.
fn decided(series: &Series, best: &Mode, other: &Mode) -> Decided {
    let (pairs, fewer) = (best.pairs(), other.pairs());
    let by_prior = best.log_prior - other.log_prior;
    let by_residuals = pairs.min(fewer) * (best.mean_log_density(series) - other.mean_log_density(series));
    // Where photos slip from trigger to trigger within their resolution, residuals fit whatever the pairs are.
    let slippery = series.interval < SLIPPERY * 2.0 * series.halves.iter().copied().fold(0.0, f64::max);
    let needed = if slippery { 30.0 } else { -OTHERS.ln() };
    let settled = by_prior >= -OTHERS.ln() || by_prior + by_residuals >= needed;
    // Holes that did not come together; one more of each may be hidden at the ends.
    let misfires = series.triggers.len() as f64 - pairs;
    let extras = photos_within(series, &best.hypothesis) as f64 - pairs;
    let chance = (misfires.max(0.0) + 1.0) * (extras.max(0.0) + 1.0) / pairs.max(1.0);
    // Were the other one true, the best would have lost a pair at each turn and yet have more.
    let coincidences = pairs - fewer + turns(series) + 1.0;
    let more = pairs - fewer >= 0.5;
    if settled || (more && coincidences >= 3.7 + chance + 3.0 * chance.sqrt()) {
        return Decided::ByTimes;
    }
    let all = series.triggers.len().min(series.photos.len()) as f64 - pairs < 0.5;
    if all && series.triggers.len() == series.photos.len() { Decided::ByCount } else { Decided::No }
}

fn clock(options: &MatchOptions, given: &Given, prior: &Prior, best: &Mode) -> ClockFit {
    let h = &best.hypothesis;
    let [[offset_variance, _], [_, drift_variance]] = best.covariance;
    let offset = h.at_pivot - h.pivot;
    // A clock known to better than a quarter of the resolution tells truncated from rounded times.
    let recording = prior.offset.and_then(|(low, high, std)| {
        let known = matches!(options.clock, ClockPrior::Known { .. } | ClockPrior::Same);
        let spread = std.hypot(offset_variance.sqrt());
        let (to_rounded, to_truncated) = ((offset - low).abs(), (offset - high).abs());
        let tells = known && high - low > 4.0 * spread;
        if tells && to_truncated < 0.25 * (high - low) {
            Some(Recording::Truncated)
        } else if tells && to_rounded < 0.25 * (high - low) {
            Some(Recording::Rounded)
        } else {
            None
        }
    });
    ClockFit {
        offset: Seconds::new(offset + given.trigger_origin - given.photo_origin),
        offset_std: Seconds::new(offset_variance.sqrt()),
        at: Seconds::new(h.pivot + given.photo_origin),
        drift_ppm: h.drift * 1e6,
        drift_std_ppm: drift_variance.sqrt() * 1e6,
        delay_std: Seconds::new(h.scale * std::f64::consts::PI / 3.0_f64.sqrt()),
        recording,
    }
}

/// For each photo its triggers with their probabilities, over the alignment's near variants and over the offsets and
/// drifts that each of them leaves open.
///
/// Of two probabilities the smaller one stands: that of the hypothesis as fitted, and that of a wary one, for which
/// misfires and extra photos are no rarer than one in twenty and late shutters are usual: a flight without many gaps
/// says little about the next one.
fn mixture(series: &Series, prior: &Prior, kin: &[&Mode]) -> Vec<Vec<(usize, f64)>> {
    const STEPS: i32 = 3;
    let heaviest = kin[0].log_weight;
    let widest = series.halves.iter().copied().fold(0.0, f64::max);
    let mut table: Vec<Vec<(usize, [f64; 2])>> = vec![Vec::new(); series.photos.len()];
    let mut total = 0.0;
    let reach = 0.5 * (series.triggers[series.triggers.len() - 1] - series.triggers[0]).max(1.0);
    for mode in kin.iter().filter(|m| m.log_weight > heaviest - 12.0) {
        let step = (0.5 * mode.hypothesis.scale).max(widest / 8.0);
        // The start of the log moves by one count, its end by the other.
        for (start, end) in (-STEPS..=STEPS).flat_map(|a| (-STEPS..=STEPS).map(move |b| (a, b))) {
            let (start, end) = (f64::from(start) * step, f64::from(end) * step);
            let at = mode.hypothesis;
            let moved = Hypothesis {
                at_pivot: at.at_pivot + 0.5 * (start + end),
                drift: at.drift + 0.5 * (end - start) / reach,
                ..at
            };
            if moved.drift.abs() > prior.drift_limit && start != end {
                continue;
            }
            let Some(sums) = Sums::new(series, &moved) else { continue };
            let share =
                (log_posterior(&sums, &moved, prior) - mode.log_sum + mode.log_weight - heaviest).exp();
            // NaN is left out as well.
            if share.is_nan() || share <= 1e-5 {
                continue;
            }
            let wary = wary(series, moved);
            let Some(wary_sums) = Sums::new(series, &wary) else { continue };
            total += share;
            add(&mut table, &sums.edges(series, &moved), [share, 0.0]);
            add(&mut table, &wary_sums.edges(series, &wary), [0.0, share]);
        }
    }
    let smaller =
        |row: Vec<(usize, [f64; 2])>| row.into_iter().map(|(j, [a, b])| (j, a.min(b) / total)).collect();
    table.into_iter().map(smaller).collect()
}

fn wary(series: &Series, h: Hypothesis) -> Hypothesis {
    const GAPS: f64 = 0.05;
    const LATE_S: f64 = 0.05;
    Hypothesis {
        misfire: h.misfire.max(GAPS),
        extra_rate: h.extra_rate.max(GAPS / series.interval),
        scale: (2.0 * h.scale).max(LATE_S).min(series.interval / 8.0).max(h.scale),
        ..h
    }
}

/// Adds the pairs' probabilities to the table, times the two shares.
fn add(table: &mut [Vec<(usize, [f64; 2])>], edges: &[Edge], shares: [f64; 2]) {
    for e in edges {
        let row = &mut table[e.photo];
        let p = shares.map(|s| s * e.probability);
        match row.iter_mut().find(|(j, _)| *j == e.trigger) {
            Some((_, sum)) => *sum = [sum[0] + p[0], sum[1] + p[1]],
            None => row.push((e.trigger, p)),
        }
    }
}

fn accept(
    photos: &[PhotoTime],
    triggers: &[Seconds],
    options: &MatchOptions,
    given: &Given,
    table: &[Vec<(usize, f64)>],
    matching: &mut Matching,
) {
    let clock = matching.clock;
    let mut photo_pair: Vec<Option<Pair>> = vec![None; photos.len()];
    let mut doubtful: Vec<Option<usize>> = vec![None; triggers.len()];
    let mut reason: Vec<PhotoReason> = vec![PhotoReason::NoTime; photos.len()];
    for ((row, &photo), unsure) in table.iter().zip(&given.photo_index).zip(&given.unsure) {
        let predicted = clock.log_time(&photos[photo]);
        let likeliest = row.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1));
        match likeliest {
            Some((trigger, probability)) if probability >= options.level && !unsure => {
                photo_pair[photo] = Some(Pair {
                    photo,
                    trigger,
                    predicted,
                    residual: predicted.map(|p| triggers[trigger] - p),
                    probability: probability.min(1.0),
                });
            }
            Some((trigger, probability)) if probability > 1.0 - options.level => {
                for (j, _) in row.iter().filter(|(_, p)| *p > 1.0 - options.level) {
                    doubtful[*j] = Some(photo);
                }
                reason[photo] = PhotoReason::Ambiguous { trigger, probability };
            }
            _ => {
                let at = predicted.map_or(0.0, Seconds::get);
                reason[photo] = PhotoReason::NoTrigger { nearest: nearest(triggers, at) };
            }
        }
    }
    let mut taken = vec![false; triggers.len()];
    for pair in photo_pair.iter().flatten() {
        taken[pair.trigger] = true;
    }
    fill_untimed(photos, &mut photo_pair, &reason, &taken.clone(), &mut taken, &doubtful);
    for (photo, pair) in photo_pair.iter().enumerate() {
        match pair {
            Some(pair) => matching.pairs.push(*pair),
            None => matching.unmatched_photos.push((photo, reason[photo])),
        }
    }
    for (j, _) in taken.iter().enumerate().filter(|(_, t)| !**t) {
        let why = doubtful[j].map_or(TriggerReason::NoPhoto, |photo| TriggerReason::Ambiguous { photo });
        matching.unmatched_triggers.push((j, why));
    }
}

/// Residual of the trigger nearest to a log time.
fn nearest(triggers: &[Seconds], at: f64) -> Seconds {
    let after = triggers.partition_point(|s| s.get() < at);
    let around = [after.checked_sub(1), Some(after)];
    let residuals = around.into_iter().flatten().filter_map(|j| triggers.get(j)).map(|s| s.get() - at);
    Seconds::new(residuals.min_by(|a, b| a.abs().total_cmp(&b.abs())).unwrap_or(f64::INFINITY))
}

/// Photos without a time between two matched neighbours take the triggers between theirs, when there are exactly as
/// many and nobody else wants them.
fn fill_untimed(
    photos: &[PhotoTime],
    pairs: &mut [Option<Pair>],
    reason: &[PhotoReason],
    taken_by_time: &[bool],
    taken: &mut [bool],
    doubtful: &[Option<usize>],
) {
    let mut i = 0;
    while i < photos.len() {
        if photos[i].time.is_some() {
            i += 1;
            continue;
        }
        let end = (i..photos.len()).find(|k| photos[*k].time.is_some()).unwrap_or(photos.len());
        let left = i.checked_sub(1).and_then(|k| pairs[k]);
        let right = pairs.get(end).copied().flatten();
        if let (Some(left), Some(right)) = (left, right)
            && right.trigger > left.trigger
            && right.trigger - left.trigger - 1 == end - i
            && (left.trigger + 1..right.trigger).all(|j| !taken_by_time[j] && doubtful[j].is_none())
            && reason[i..end].iter().all(|r| *r == PhotoReason::NoTime)
        {
            for (k, photo) in (i..end).enumerate() {
                let trigger = left.trigger + 1 + k;
                taken[trigger] = true;
                pairs[photo] = Some(Pair {
                    photo,
                    trigger,
                    predicted: None,
                    residual: None,
                    probability: left.probability.min(right.probability),
                });
            }
        }
        i = end;
    }
}
