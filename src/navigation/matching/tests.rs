//! Simulated flights with known pairs: an accepted pair must be a true one.

use super::*;
use proptest::prelude::*;

/// SplitMix64: the same numbers on every machine.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }
    fn count(&mut self, low: usize, high: usize) -> usize {
        low + (self.next() % (high - low + 1) as u64) as usize
    }
    fn chance(&mut self, p: f64) -> bool {
        self.uniform(0.0, 1.0) < p
    }
    fn normal(&mut self) -> f64 {
        let u = self.uniform(1e-300, 1.0);
        (-2.0 * u.ln()).sqrt() * self.uniform(0.0, std::f64::consts::TAU).cos()
    }
    fn of<T: Copy>(&mut self, list: &[T]) -> T {
        list[self.count(0, list.len() - 1)]
    }
}

/// What goes wrong, and how the camera's clock stands.
#[derive(Debug, Clone, Copy)]
struct Troubles {
    misfire: f64,
    missing_event: f64,
    extra_photos: usize,
    late_shutter: f64,
    delay_std: f64,
    offset: f64,
    drift_ppm: f64,
    resolution: f64,
    rounded: bool,
    jumbled: bool,
}

impl Troubles {
    const NONE: Self = Self {
        misfire: 0.0,
        missing_event: 0.0,
        extra_photos: 0,
        late_shutter: 0.0,
        delay_std: 0.02,
        offset: 14_403.7,
        drift_ppm: 0.0,
        resolution: 1.0,
        rounded: false,
        jumbled: false,
    };

    fn random(r: &mut Random) -> Self {
        Self {
            misfire: r.of(&[0.0, 0.01, 0.05]),
            missing_event: r.of(&[0.0, 0.0, 0.02, 0.05]),
            extra_photos: r.of(&[0, 0, 2, 10]),
            late_shutter: r.of(&[0.0, 0.01]),
            delay_std: r.uniform(0.002, 0.06),
            offset: r.of(&[14_403.7, 0.0, -7_200.0, 1.7e9]) + r.uniform(-2000.0, 2000.0),
            drift_ppm: r.uniform(-300.0, 300.0),
            resolution: r.of(&[1.0, 1.0, 1.0, 0.1, 0.01]),
            rounded: r.chance(0.3),
            jumbled: r.chance(0.1),
        }
    }
}

struct Flight {
    photos: Vec<PhotoTime>,
    triggers: Vec<Seconds>,
    /// For each photo the trigger it came from.
    truth: Vec<Option<usize>>,
    /// When each photo was really taken, on the log's clock.
    shot: Vec<f64>,
}

impl Flight {
    fn coincidence(&self, pair: &Pair) -> bool {
        let near = self.photos[pair.photo].resolution.get() + 0.1;
        self.truth[pair.photo].is_none()
            && !self.truth.contains(&Some(pair.trigger))
            && (self.shot[pair.photo] - self.triggers[pair.trigger].get() - 0.08).abs() < near
    }
}

/// Photos and the log of a list of exposure commands.
fn fly(commands: &[f64], t: &Troubles, r: &mut Random) -> Flight {
    let mut triggers = Vec::new();
    let mut shots: Vec<(f64, Option<usize>)> = Vec::new();
    for s in commands {
        let logged = !r.chance(t.missing_event);
        if logged {
            triggers.push(Seconds::new(*s));
        }
        if !r.chance(t.misfire) {
            let late = if r.chance(t.late_shutter) { 0.3 } else { 0.0 };
            let at = s + 0.08 + late + t.delay_std * r.normal();
            shots.push((at, logged.then(|| triggers.len() - 1)));
        }
    }
    let (first, last) = (commands[0], commands[commands.len() - 1]);
    for _ in 0..t.extra_photos {
        shots.push((r.uniform(first - 300.0, last + 60.0), None));
    }
    shots.sort_by(|a, b| a.0.total_cmp(&b.0));
    let step = t.resolution;
    let mut photos: Vec<(PhotoTime, Option<usize>, f64)> = shots
        .iter()
        .map(|(s, truth)| {
            let camera = (s - t.offset) / (1.0 + t.drift_ppm * 1e-6);
            let units = if t.rounded { (camera / step).round() } else { (camera / step).floor() };
            let time = Some(Seconds::new(units * step));
            (PhotoTime { time, resolution: Seconds::new(step) }, *truth, *s)
        })
        .collect();
    if t.jumbled {
        // The file counter wrapped: the last photos sort first.
        let by = photos.len() / 3;
        photos.rotate_left(by);
    }
    Flight {
        photos: photos.iter().map(|p| p.0).collect(),
        triggers,
        truth: photos.iter().map(|p| p.1).collect(),
        shot: photos.iter().map(|p| p.2).collect(),
    }
}

/// Strips flown by distance, with and against a wind and through gusts; turns in between.
fn strips(r: &mut Random) -> Vec<f64> {
    let (count, length) = (r.count(2, 8), r.count(8, 60));
    let (spacing, speed, wind) = (r.uniform(10.0, 60.0), r.uniform(8.0, 20.0), r.uniform(0.0, 5.0));
    let mut commands = Vec::new();
    let mut s = r.uniform(100.0, 1000.0);
    for strip in 0..count {
        let ground = if strip % 2 == 0 { speed + wind } else { speed - wind };
        let mut gust = 0.0;
        for _ in 0..length.saturating_add_signed(r.count(0, 6) as isize - 3) {
            gust = 0.8 * gust + 0.02 * r.normal();
            s += spacing / (ground * (1.0 + gust)).max(3.0);
            commands.push(s);
        }
        s += r.uniform(8.0, 30.0);
    }
    commands
}

/// A timer with jitter, perhaps stopped a few times.
fn time_lapse(r: &mut Random) -> Vec<f64> {
    let interval = r.of(&[0.7, 1.0, 1.5, 2.0, 3.0, 5.0]);
    let jitter = r.of(&[0.0, 0.005, 0.02, 0.1]) * interval;
    let (count, stops) = (r.count(10, 400), r.count(0, 4));
    let mut s = r.uniform(0.0, 1000.0);
    (0..count)
        .map(|_| {
            s += interval + jitter * r.uniform(-1.0, 1.0);
            if r.chance(stops as f64 / count as f64) {
                s += r.uniform(1.0, 60.0);
            }
            s
        })
        .collect()
}

#[derive(Debug, Default, Clone, Copy)]
struct Tally {
    right: usize,
    wrong: usize,
    /// Wrong pairs that no times could show: a photo without an event, taken within the resolution of a trigger that
    /// misfired.
    coincidences: usize,
    /// True pairs not accepted within accepted matchings.
    left_out: usize,
    accepted: usize,
    refused: usize,
    /// Matchings with a wrong pair.
    bad: usize,
}

impl Tally {
    fn add(&mut self, flight: &Flight, options: &MatchOptions, seed: u64) {
        match match_exposures(&flight.photos, &flight.triggers, options) {
            Ok(m) => {
                let right = m.pairs.iter().filter(|p| flight.truth[p.photo] == Some(p.trigger)).count();
                let coincidences = m.pairs.iter().filter(|p| flight.coincidence(p)).count();
                let wrong = m.pairs.len() - right - coincidences;
                self.coincidences += coincidences;
                self.accepted += 1;
                self.right += right;
                self.wrong += wrong;
                self.left_out += flight.truth.iter().flatten().count() - right;
                self.bad += usize::from(wrong > 0);
                if wrong > 0 {
                    eprintln!(
                        "seed {seed}: {wrong} of {} wrong, {} triggers; {:?} {:?} count {} p {}",
                        m.pairs.len(),
                        flight.triggers.len(),
                        m.clock,
                        m.runner_up,
                        m.rests_on_count,
                        m.probability
                    );
                }
                check_bookkeeping(flight, &m);
            }
            Err(e) => {
                self.refused += 1;
                if std::env::var_os("MATCHING_VERBOSE").is_some() {
                    eprintln!(
                        "seed {seed}: {} photos {} triggers: {e}",
                        flight.photos.len(),
                        flight.triggers.len()
                    );
                }
            }
        }
    }
}

/// Every photo and trigger stands in exactly one list, and predictions follow the stated clock.
fn check_bookkeeping(flight: &Flight, m: &Matching) {
    let mut photos = vec![0; flight.photos.len()];
    let mut triggers = vec![0; flight.triggers.len()];
    for p in &m.pairs {
        photos[p.photo] += 1;
        triggers[p.trigger] += 1;
        if let (Some(predicted), Some(residual)) = (p.predicted, p.residual) {
            let again = m.clock.log_time(&flight.photos[p.photo]).unwrap();
            assert_eq!(predicted, again);
            assert!((flight.triggers[p.trigger] - predicted - residual).get().abs() < 1e-9);
        }
    }
    m.unmatched_photos.iter().for_each(|(i, _)| photos[*i] += 1);
    m.unmatched_triggers.iter().for_each(|(j, _)| triggers[*j] += 1);
    assert!(photos.iter().chain(&triggers).all(|n| *n == 1));
}

fn campaign(generator: fn(&mut Random) -> Vec<f64>, seeds: std::ops::Range<u64>) -> Tally {
    let mut tally = Tally::default();
    for seed in seeds {
        let mut r = Random(seed);
        let commands = generator(&mut r);
        let troubles = Troubles::random(&mut r);
        let flight = fly(&commands, &troubles, &mut r);
        tally.add(&flight, &MatchOptions::default(), seed);
    }
    tally
}

/// Flights of each kind: BORESIGHT_FLIGHTS at compile time asks for more than the sample.
fn flights(sample: u64) -> u64 {
    option_env!("BORESIGHT_FLIGHTS").and_then(|text| text.parse().ok()).unwrap_or(sample)
}

/// A wrong pair now and then is unavoidable (a photo by hand at the very moment of a misfire); more than one in a hundred
/// thousand is not.
#[test]
fn wrong_pairs_are_not_accepted_in_simulated_flights() {
    let surveys = campaign(strips, 0..flights(60));
    let timers = campaign(time_lapse, 0..flights(40));
    assert!(
        (surveys.wrong + timers.wrong) * 100_000 <= surveys.right + timers.right,
        "{surveys:?} {timers:?}"
    );
    assert!(
        surveys.accepted * 3 >= 2 * flights(60) as usize && surveys.left_out * 20 < surveys.right,
        "{surveys:?}"
    );
    assert!(timers.accepted * 8 >= flights(40) as usize, "{timers:?}");
}

fn seconds(times: impl IntoIterator<Item = f64>) -> Vec<Seconds> {
    times.into_iter().map(Seconds::new).collect()
}

fn whole(times: impl IntoIterator<Item = f64>) -> Vec<PhotoTime> {
    let one = Seconds::new(1.0);
    times.into_iter().map(|t| PhotoTime { time: Some(Seconds::new(t.floor())), resolution: one }).collect()
}

#[test]
fn whole_seconds_drift_misfires_and_a_time_zone_are_sorted_out() {
    for seed in 0..10 {
        let mut r = Random(seed);
        let commands: Vec<f64> = (0..6)
            .flat_map(|strip| (0..40).map(move |k| 300.0 * f64::from(strip) + 2.3 * f64::from(k)))
            .collect();
        let troubles = Troubles {
            misfire: 0.05,
            missing_event: 0.02,
            extra_photos: 3,
            drift_ppm: 300.0,
            offset: 4.0 * 3600.0 + 3.7,
            ..Troubles::NONE
        };
        let flight = fly(&commands, &troubles, &mut r);
        let m = match_exposures(&flight.photos, &flight.triggers, &MatchOptions::default()).unwrap();
        assert!(m.pairs.iter().all(|p| flight.truth[p.photo] == Some(p.trigger) || flight.coincidence(p)));
        assert!(m.pairs.len() + 6 > flight.truth.iter().flatten().count(), "{}", m.pairs.len());
        check_bookkeeping(&flight, &m);
        // Shutters are 0.08 s late: the camera's clock says more by that.
        let c = m.clock;
        let truth = troubles.offset - 0.08 + troubles.drift_ppm * 1e-6 * c.at.get();
        let error = c.offset.get() - truth;
        assert!(error.abs() < 4.0 * c.offset_std.get(), "{error} {c:?}");
        assert!((c.drift_ppm - 300.0).abs() < 4.0 * c.drift_std_ppm && c.drift_std_ppm < 60.0, "{c:?}");
    }
}

#[test]
fn an_evenly_spaced_flight_with_a_photo_lost_is_refused_until_something_settles_it() {
    let triggers = seconds((0..60).map(|k| 2.0 * f64::from(k)));
    // The first trigger misfired, or the last one: nobody can tell.
    let photos = whole((1..60).map(|k| 2.0 * f64::from(k) + 7200.4));
    let unknown = MatchOptions::default();
    let refused = match_exposures(&photos, &triggers, &unknown);
    let Err(MatchError::Ambiguous { pairs, other_pairs, shift_s, .. }) = refused else {
        panic!("{refused:?}")
    };
    assert_eq!((pairs, other_pairs), (59, 59));
    assert!((shift_s.abs() - 2.0).abs() < 0.01, "{shift_s}");
    let declared = ClockPrior::Known { offset: Seconds::new(-7200.3), std: Seconds::new(0.3) };
    for clock in [declared, ClockPrior::Anchor { photo: 3, trigger: 4 }] {
        let m = match_exposures(&photos, &triggers, &MatchOptions { clock, ..unknown }).unwrap();
        assert_eq!(m.pairs.len(), 59);
        assert!(m.pairs.iter().all(|p| p.trigger == p.photo + 1) && !m.rests_on_count);
        assert_eq!(m.unmatched_triggers, [(0, TriggerReason::NoPhoto)]);
    }
    // All of them there: their number decides, and that is said.
    let all = whole((0..60).map(|k| 2.0 * f64::from(k) + 7200.4));
    let m = match_exposures(&all, &triggers, &unknown).unwrap();
    assert!(m.rests_on_count && m.pairs.len() == 60 && m.pairs.iter().all(|p| p.trigger == p.photo));
}

#[test]
fn a_known_clock_tells_truncated_from_rounded_times() {
    let mut r = Random(5);
    let commands = strips(&mut r);
    for (rounded, recording) in [(false, Recording::Truncated), (true, Recording::Rounded)] {
        let flight = fly(&commands, &Troubles { rounded, ..Troubles::NONE }, &mut r);
        let clock = ClockPrior::Known { offset: Seconds::new(14_403.62), std: Seconds::new(0.05) };
        let options = MatchOptions { clock, ..MatchOptions::default() };
        let m = match_exposures(&flight.photos, &flight.triggers, &options).unwrap();
        assert_eq!(m.clock.recording, Some(recording));
        assert!(m.pairs.iter().all(|p| flight.truth[p.photo] == Some(p.trigger)));
    }
}

#[test]
fn photos_on_the_logs_clock_need_no_search() {
    // GPS time in milliseconds, evenly spaced, first and last photo missing.
    let triggers = seconds((0..20).map(|k| 1.5e9 + f64::from(k)));
    let photos: Vec<PhotoTime> = (1..19)
        .map(|k| PhotoTime {
            time: Some(Seconds::new(1.5e9 + f64::from(k) + 0.031)),
            resolution: Seconds::new(0.001),
        })
        .collect();
    let options = MatchOptions { clock: ClockPrior::Same, ..MatchOptions::default() };
    let m = match_exposures(&photos, &triggers, &options).unwrap();
    assert_eq!(m.pairs.len(), 18);
    assert!(m.pairs.iter().all(|p| p.trigger == p.photo + 1 && p.probability > 0.99));
}

#[test]
fn series_that_do_not_belong_together_are_refused() {
    for seed in 0..30 {
        let mut r = Random(seed);
        let (one, other) = (strips(&mut r), strips(&mut r));
        let a = fly(&one, &Troubles::NONE, &mut r);
        let b = fly(&other, &Troubles::NONE, &mut r);
        let got = match_exposures(&a.photos, &b.triggers, &MatchOptions::default());
        let refused = matches!(
            got,
            Err(MatchError::Ambiguous { .. } | MatchError::Unrelated { .. } | MatchError::TooCoarse { .. })
        );
        assert!(refused, "{seed} {got:?}");
    }
}

#[test]
fn a_photo_without_time_takes_the_one_trigger_between_its_neighbours() {
    let mut r = Random(11);
    let commands = strips(&mut r);
    let flight = fly(&commands, &Troubles::NONE, &mut r);
    let mut photos = flight.photos.clone();
    for k in [4, 9, 10] {
        photos[k].time = None;
    }
    let m = match_exposures(&photos, &flight.triggers, &MatchOptions::default()).unwrap();
    assert!(m.pairs.iter().all(|p| p.trigger == p.photo) && m.pairs.len() == photos.len());
    assert!(m.pairs[9].predicted.is_none() && m.pairs[9].residual.is_none());
    // Two photos for three triggers: nobody knows which.
    let mut fewer = photos.clone();
    fewer.remove(11);
    let m = match_exposures(&fewer, &flight.triggers, &MatchOptions::default()).unwrap();
    assert_eq!(m.unmatched_photos, [(9, PhotoReason::NoTime), (10, PhotoReason::NoTime)]);
    assert_eq!(m.unmatched_triggers.len(), 3);
}

#[test]
fn values_that_are_no_times_are_named() {
    let good_photos = whole((0..10).map(|k| 3.0 * f64::from(k)));
    let good = seconds((0..10).map(|k| 3.0 * f64::from(k)));
    let options = MatchOptions::default();
    for bad in [f64::NAN, f64::INFINITY, -1e300] {
        let mut photos = good_photos.clone();
        photos[7].time = Some(Seconds::new(bad));
        assert!(matches!(match_exposures(&photos, &good, &options), Err(MatchError::Photo { index: 7, .. })));
        photos[7] = PhotoTime { resolution: Seconds::new(bad), ..good_photos[7] };
        assert!(matches!(match_exposures(&photos, &good, &options), Err(MatchError::Photo { index: 7, .. })));
        let mut triggers = good.clone();
        triggers[4] = Seconds::new(bad);
        let got = match_exposures(&good_photos, &triggers, &options);
        assert!(matches!(got, Err(MatchError::Trigger { index: 4 | 5, .. })), "{got:?}");
        let level = MatchOptions { level: bad, ..options };
        assert!(matches!(match_exposures(&good_photos, &good, &level), Err(MatchError::Option(_))));
        let clock = ClockPrior::Known { offset: Seconds::new(bad), std: Seconds::new(1.0) };
        let known = MatchOptions { clock, ..options };
        assert!(matches!(match_exposures(&good_photos, &good, &known), Err(MatchError::Option(_))));
    }
    // Twice the same instant, and one that goes back.
    for second in [3.0, 2.0] {
        let triggers = seconds([0.0, 3.0, second, 9.0, 12.0]);
        let got = match_exposures(&good_photos, &triggers, &options);
        assert!(matches!(got, Err(MatchError::Trigger { index: 2, .. })));
    }
    assert!(matches!(
        match_exposures(&[], &[], &options),
        Err(MatchError::TooFew { photos: 0, triggers: 0, .. })
    ));
    assert!(matches!(match_exposures(&good_photos[..3], &good, &options), Err(MatchError::TooFew { .. })));
    let anchor = MatchOptions { clock: ClockPrior::Anchor { photo: 99, trigger: 0 }, ..options };
    assert!(matches!(match_exposures(&good_photos, &good, &anchor), Err(MatchError::Option(_))));
    // 3,000 photos of one minute and as many triggers in it.
    let minute = PhotoTime { time: Some(Seconds::new(0.0)), resolution: Seconds::new(60.0) };
    let burst = seconds((0..3000).map(|k| 0.02 * f64::from(k)));
    assert!(matches!(
        match_exposures(&vec![minute; 3000], &burst, &options),
        Err(MatchError::TooCoarse { .. })
    ));
    let crowd = vec![good_photos[0]; 100_001];
    assert!(matches!(match_exposures(&crowd, &good, &options), Err(MatchError::TooMany { .. })));
}

#[test]
fn order_and_numbers_say_what_they_assume() {
    let m = match_in_order(3, 3).unwrap();
    assert_eq!(m.pairs, [(0, 0), (1, 1), (2, 2)]);
    assert!(m.assumed.contains("taken for granted"));
    assert!(match_in_order(3, 4).is_err() && match_in_order(0, 0).is_err());

    let m = match_by_number(&[Some(2), None, Some(3), Some(9)], &[Some(1), Some(2), Some(3)]).unwrap();
    assert_eq!(m.pairs, [(0, 1), (2, 2)]);
    assert_eq!((m.unmatched_photos, m.unmatched_triggers), (vec![1, 3], vec![0]));
    assert!(matches!(
        match_by_number(&[Some(2), Some(2)], &[Some(2)]),
        Err(MatchError::Photo { index: 1, .. })
    ));
    assert!(matches!(
        match_by_number(&[Some(2)], &[Some(5), Some(2), Some(5)]),
        Err(MatchError::Trigger { index: 2, .. })
    ));
    assert!(match_by_number(&[Some(101), Some(102), Some(103)], &[Some(1), Some(2), Some(101)]).is_err());
    assert!(match_by_number(&[None, None], &[Some(1)]).is_err());
}

/// The sum over alignments against all of them written out.
#[test]
fn the_sum_over_alignments_is_that_of_their_list() {
    use super::model::{Hypothesis, Series, Sums, density};
    let series = Series {
        photos: vec![0.0, 0.4, 1.1, 2.0],
        halves: vec![0.5; 4],
        triggers: vec![-0.2, 0.3, 0.9, 1.4, 2.2],
        interval: 0.6,
        span: 2.4,
    };
    let h = Hypothesis { pivot: 0.3, at_pivot: 0.35, drift: 1e-4, scale: 0.1, misfire: 0.1, extra_rate: 0.2 };
    let weight = |i: usize, j: usize| {
        0.9 / (0.1 * 0.2) * density(series.triggers[j] - h.predict(series.photos[i]), 0.5, 0.1)
    };
    // Each photo takes a trigger after the last one taken, or none (5).
    let mut total = 0.0;
    let mut with = [[0.0; 5]; 4];
    for code in 0..6_usize.pow(4) {
        let taken: Vec<usize> = (0..4).map(|i| code / 6_usize.pow(i) % 6).collect();
        let used: Vec<usize> = taken.iter().copied().filter(|j| *j < 5).collect();
        if used.windows(2).any(|w| w[1] <= w[0]) {
            continue;
        }
        let pairs = || taken.iter().enumerate().filter(|(_, j)| **j < 5);
        let product: f64 = pairs().map(|(i, j)| weight(i, *j)).product();
        total += product;
        pairs().for_each(|(i, j)| with[i][*j] += product);
    }
    let sums = Sums::new(&series, &h).unwrap();
    let common = 5.0 * 0.1_f64.ln() + 4.0 * 0.2_f64.ln() - 0.2 * 2.4;
    assert!((sums.log_sum - total.ln() - common).abs() < 1e-9);
    let edges = sums.edges(&series, &h);
    assert!(edges.len() > 10);
    for e in edges {
        assert!((e.probability - with[e.photo][e.trigger] / total).abs() < 1e-9, "{e:?}");
    }
}

proptest! {
    #[test]
    fn any_values_give_an_answer_or_an_error(
        photos in prop::collection::vec((prop::option::of(-1e5..1e5_f64), prop::num::f64::ANY, any::<bool>()), 0..40),
        triggers in prop::collection::vec(-1e5..1e5_f64, 0..40),
        wild in prop::collection::vec(prop::num::f64::ANY, 0..3),
        offset in prop::num::f64::ANY,
        known in any::<bool>(),
    ) {
        let photos: Vec<PhotoTime> = photos
            .iter()
            .map(|(t, r, tame)| PhotoTime {
                time: t.map(Seconds::new),
                resolution: Seconds::new(if *tame || wild.is_empty() { 1.0 } else { *r }),
            })
            .collect();
        let mut triggers = triggers;
        if !known {
            triggers.sort_by(f64::total_cmp);
        }
        triggers.extend(&wild);
        let triggers = seconds(triggers);
        let clock = if known && offset.is_finite() {
            ClockPrior::Known { offset: Seconds::new(offset), std: Seconds::new(1.0) }
        } else {
            ClockPrior::Unknown
        };
        if let Ok(m) = match_exposures(&photos, &triggers, &MatchOptions { clock, ..MatchOptions::default() }) {
            let flight = Flight { truth: vec![], shot: vec![], photos, triggers };
            check_bookkeeping(&flight, &m);
        }
    }
}
