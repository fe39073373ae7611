//! Matching without times: by equal counts, or by numbers that both sides carry. Each says what it took for granted.

use super::MatchError;
use std::collections::BTreeMap;

/// Pairs that rest on order or numbers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OrderMatch {
    /// Photo and trigger, in the photos' order.
    pub pairs: Vec<(usize, usize)>,
    /// Photos without a trigger.
    pub unmatched_photos: Vec<usize>,
    /// Triggers without a photo.
    pub unmatched_triggers: Vec<usize>,
    /// What was taken for granted: a sentence for the user.
    pub assumed: String,
}

/// Pairs the first photo with the first trigger, and so on, when there are as many of one as of the other.
///
/// # Errors
/// [`MatchError::Order`] when the counts differ or are zero: no order then says which one lacks its partner.
pub fn match_in_order(photos: usize, triggers: usize) -> Result<OrderMatch, MatchError> {
    if photos == 0 || photos != triggers {
        return Err(MatchError::Order(format!(
            "{photos} photos without times and {triggers} triggers cannot be paired by order: the counts differ or are zero, and nothing says which one lacks its partner; give the photos' times or numbers"
        )));
    }
    Ok(OrderMatch {
        pairs: (0..photos).map(|i| (i, i)).collect(),
        unmatched_photos: Vec::new(),
        unmatched_triggers: Vec::new(),
        assumed: format!(
            "{photos} photos and as many triggers were paired in their order: it was taken for granted that every trigger gave one photo and no photo was taken otherwise"
        ),
    })
}

/// Pairs photos and triggers that carry the same number (DJI's frames and .MRK lines).
///
/// # Errors
/// [`MatchError`] for a number that occurs twice on one side, with the index of its second holder, and when fewer than
/// half of the numbers of the smaller side are found on the other: the two count different things then.
pub fn match_by_number(photos: &[Option<u64>], triggers: &[Option<u64>]) -> Result<OrderMatch, MatchError> {
    let photo_of = index(photos)
        .map_err(|(index, number)| MatchError::Photo { index, cause: twice("photo", number) })?;
    let trigger_of = index(triggers)
        .map_err(|(index, number)| MatchError::Trigger { index, cause: twice("trigger", number) })?;
    let pairs: Vec<(usize, usize)> = photos
        .iter()
        .enumerate()
        .filter_map(|(i, n)| n.as_ref().and_then(|n| trigger_of.get(n)).map(|j| (i, *j)))
        .collect();
    let fewer = photo_of.len().min(trigger_of.len());
    // As many of one as of the other, and yet other numbers: a counter that starts elsewhere.
    let shifted = photos.len() == triggers.len() && pairs.len() < photo_of.len();
    if pairs.is_empty() || shifted || 2 * pairs.len() < fewer {
        return Err(MatchError::Order(format!(
            "only {} of {} numbered photos carry the number of one of {} numbered triggers: they do not count the same thing",
            pairs.len(),
            photo_of.len(),
            trigger_of.len()
        )));
    }
    let paired: std::collections::BTreeSet<usize> = pairs.iter().map(|(_, j)| *j).collect();
    let unmatched_photos = (0..photos.len())
        .filter(|i| photos[*i].is_none_or(|number| !trigger_of.contains_key(&number)))
        .collect();
    Ok(OrderMatch {
        unmatched_photos,
        unmatched_triggers: (0..triggers.len()).filter(|j| !paired.contains(j)).collect(),
        assumed: format!(
            "{} photos were paired with triggers by equal numbers: it was taken for granted that both count the same exposures",
            pairs.len()
        ),
        pairs,
    })
}

fn twice(what: &str, number: u64) -> String {
    format!("its number {number} is that of an earlier {what}")
}

/// Where each number stands; the second holder of a number is an error.
fn index(numbers: &[Option<u64>]) -> Result<BTreeMap<u64, usize>, (usize, u64)> {
    let mut places = BTreeMap::new();
    for (place, number) in numbers.iter().enumerate() {
        if let Some(number) = number
            && places.insert(*number, place).is_some()
        {
            return Err((place, *number));
        }
    }
    Ok(places)
}
