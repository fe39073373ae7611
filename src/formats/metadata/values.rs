//! Numbers, dates and texts as metadata writes them.

use crate::units::Seconds;
use jiff::civil;

/// A decimal number or a rational "n/d".
///
/// # Errors
/// Words for text that is no number, a zero denominator, or a value that is not finite.
pub(super) fn number(text: &str) -> Result<f64, String> {
    let plain = |t: &str| {
        let t = t.trim();
        t.parse::<f64>().ok().filter(|v| v.is_finite()).ok_or_else(|| format!("{} is no number", quoted(t)))
    };
    match text.split_once('/') {
        None => plain(text),
        Some((numerator, denominator)) => {
            let (n, d) = (plain(numerator)?, plain(denominator)?);
            if d == 0.0 {
                return Err(format!("{} has a zero denominator", quoted(text.trim())));
            }
            Some(n / d).filter(|v| v.is_finite()).ok_or_else(|| format!("{} is too large", quoted(text)))
        }
    }
}

/// Numbers between commas.
///
/// # Errors
/// As [`number`], or when there are more than 64.
pub(super) fn numbers(text: &str) -> Result<Vec<f64>, String> {
    if text.split(',').nth(64).is_some() {
        return Err("more than 64 numbers".to_owned());
    }
    text.split(',').filter(|t| !t.trim().is_empty()).map(number).collect()
}

/// A text for a message: short, without control characters.
pub(super) fn quoted(text: &str) -> String {
    let mut shown: String = text.chars().take(40).map(|c| if c.is_control() { '?' } else { c }).collect();
    if text.chars().nth(40).is_some() {
        shown.push('…');
    }
    format!("\"{shown}\"")
}

/// An instant on some wall clock.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WallClock {
    /// Seconds since 1970-01-01T00:00:00 of that clock.
    pub seconds: f64,
    /// The last digit's worth, seconds.
    pub resolution_s: f64,
}

/// `YYYY:MM:DD HH:MM:SS` or ISO 8601, with or without a fraction of the second and "Z".
///
/// # Errors
/// Words for text of another form, a date or time that does not exist, or a year outside 1980 to 2100.
pub(super) fn wall_clock(text: &str) -> Result<WallClock, String> {
    let text = text.trim();
    let bad = || format!("{} is no date and time", quoted(text));
    let (date, time) = text.split_once(['T', ' ']).ok_or_else(bad)?;
    let (hour, rest) = time.trim_start().split_once(':').ok_or_else(bad)?;
    let (minute, rest) = rest.split_once(':').ok_or_else(bad)?;
    let end = rest.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(rest.len());
    let (second, zone) = rest.split_at(end);
    let (whole, fraction) = second.split_once('.').unwrap_or((second, ""));
    let day = date_seconds(date)?;
    let clock = [(hour, 24), (minute, 60), (whole, 60)].map(|(t, limit)| digits(t).filter(|v| *v < limit));
    let [Some(h), Some(m), Some(s)] = clock else { return Err(bad()) };
    let (fraction_s, resolution_s) = fraction_of_second(fraction).ok_or_else(bad)?;
    let zone = zone.trim();
    if !matches!(zone, "" | "Z" | "z" | "+00:00") {
        return Err(format!("{} ends in {}, which is not UTC", quoted(text), quoted(zone)));
    }
    let seconds = day + f64::from(3600 * h + 60 * m + s) + fraction_s;
    Ok(WallClock { seconds, resolution_s })
}

/// Seconds since 1970 of a day's midnight: `YYYY:MM:DD` or `YYYY-MM-DD`.
///
/// # Errors
/// As [`wall_clock`].
pub(super) fn date_seconds(text: &str) -> Result<f64, String> {
    let text = text.trim();
    let bad = || format!("{} is no date", quoted(text));
    let mut parts = text.split([':', '-', '/']);
    let mut next = || parts.next().and_then(digits);
    let (Some(year), Some(month), Some(day)) = (next(), next(), next()) else { return Err(bad()) };
    if parts.next().is_some() {
        return Err(bad());
    }
    if !(1980..=2100).contains(&year) {
        return Err(format!("the year {year} of {} lies outside 1980 to 2100", quoted(text)));
    }
    let date = i16::try_from(year)
        .ok()
        .and_then(|year| civil::Date::new(year, i8::try_from(month).ok()?, i8::try_from(day).ok()?).ok());
    let epoch = civil::date(1970, 1, 1);
    let days = date.and_then(|d| d.since((jiff::Unit::Day, epoch)).ok()).ok_or_else(bad)?.get_days();
    Ok(86_400.0 * f64::from(days))
}

/// Digits after the decimal point as a fraction of a second, and the last digit's worth; none: (0, 1).
pub(super) fn fraction_of_second(text: &str) -> Option<(f64, f64)> {
    let text = text.trim();
    if text.is_empty() {
        return Some((0.0, 1.0));
    }
    if text.len() > 9 || !text.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    let resolution = 10f64.powi(-i32::try_from(text.len()).ok()?);
    Some((text.parse::<f64>().ok()? * resolution, resolution))
}

/// `±HH:MM` or `Z` east of UTC.
pub(super) fn utc_offset(text: &str) -> Option<Seconds> {
    let text = text.trim();
    if text.eq_ignore_ascii_case("z") {
        return Some(Seconds::new(0.0));
    }
    let (sign, rest) = match text.split_at_checked(1)? {
        ("+", rest) => (1.0, rest),
        ("-", rest) => (-1.0, rest),
        _ => return None,
    };
    let (hours, minutes) = rest.split_once(':')?;
    let (hours, minutes) = (digits(hours)?, digits(minutes)?);
    // Kiribati keeps +14:00, the most there is.
    (hours <= 14 && minutes < 60).then(|| Seconds::new(sign * f64::from(3600 * hours + 60 * minutes)))
}

fn digits(text: &str) -> Option<u32> {
    ((1..=4).contains(&text.len()) && text.bytes().all(|b| b.is_ascii_digit())).then(|| text.parse().ok())?
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_decimal_or_rational() {
        assert_eq!(number(" +198.31 "), Ok(198.31));
        assert_eq!(number("-3/4"), Ok(-0.75));
        for bad in ["1/0", "0/0", "", "nan", "inf", "1e999", "12 m", "1/2/3", "1/nan"] {
            assert!(number(bad).is_err(), "{bad}");
        }
        assert_eq!(numbers("1, 2,3"), Ok(vec![1.0, 2.0, 3.0]));
        assert!(numbers(&"1,".repeat(100)).is_err());
    }

    #[test]
    fn times_are_those_of_the_calendar() {
        // GNU date: date -u -d '2013-06-04T17:38:09Z' +%s
        let time = wall_clock("2013-06-04T17:38:09").unwrap();
        assert_eq!((time.seconds, time.resolution_s), (1_370_367_489.0, 1.0));
        let time = wall_clock("2016:02:29 23:59:59.250Z").unwrap();
        assert_eq!((time.seconds, time.resolution_s), (1_456_790_399.25, 0.001));
        for bad in [
            "0001:01:01 00:00:00",
            "1979:12:31 00:00:00",
            "2101:01:01 00:00:00",
            "2015:02:29 00:00:00",
            "2015:02:28 24:00:00",
            "2015:02:28 23:60:00",
            "2015:02:28",
            "    :  :     :  :  ",
            "2015:02:28 23:00:00+02:00",
            "2015:02:28 23:00:0x",
            "é015:02:28 23:00:00",
        ] {
            assert!(wall_clock(bad).is_err(), "{bad}");
        }
        assert_eq!(utc_offset("-05:30").map(Seconds::get), Some(-19_800.0));
        assert_eq!(utc_offset("+15:00"), None);
        assert_eq!(utc_offset("é"), None);
    }
}
