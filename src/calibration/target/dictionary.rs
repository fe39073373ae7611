//! Sets of square markers: which cells inside the black border are white.

mod april;
mod five;
mod four;
mod seven;
mod six;

use super::{BoardPoint, Ink, Shape};

/// A set of markers, numbered from 0.
#[derive(Debug)]
pub struct Dictionary {
    name: &'static str,
    side: usize,
    markers: usize,
    /// Least number of cells in which two markers, or one and its own turn, differ in any turns.
    distance: usize,
    words: Words,
}

/// Where the cells of a marker come from.
#[derive(Debug)]
enum Words {
    /// One word per marker.
    Table(&'static [u64]),
    /// The same, turned by half.
    Turned(&'static [u64]),
    /// The first ArUco markers: every row is one of four words and stands for two bits of the number.
    Rows,
}

const ALL: [Dictionary; 23] = [
    set("DICT_4X4_50", 4, 50, 4, &four::WORDS),
    set("DICT_4X4_100", 4, 100, 3, &four::WORDS),
    set("DICT_4X4_250", 4, 250, 3, &four::WORDS),
    set("DICT_4X4_1000", 4, 1000, 2, &four::WORDS),
    set("DICT_5X5_50", 5, 50, 8, &five::WORDS),
    set("DICT_5X5_100", 5, 100, 7, &five::WORDS),
    set("DICT_5X5_250", 5, 250, 6, &five::WORDS),
    set("DICT_5X5_1000", 5, 1000, 5, &five::WORDS),
    set("DICT_6X6_50", 6, 50, 13, &six::WORDS),
    set("DICT_6X6_100", 6, 100, 12, &six::WORDS),
    set("DICT_6X6_250", 6, 250, 11, &six::WORDS),
    set("DICT_6X6_1000", 6, 1000, 9, &six::WORDS),
    set("DICT_7X7_50", 7, 50, 19, &seven::WORDS),
    set("DICT_7X7_100", 7, 100, 18, &seven::WORDS),
    set("DICT_7X7_250", 7, 250, 17, &seven::WORDS),
    set("DICT_7X7_1000", 7, 1000, 14, &seven::WORDS),
    Dictionary { name: "DICT_ARUCO_ORIGINAL", side: 5, markers: 1024, distance: 0, words: Words::Rows },
    set("tag16h5", 4, 30, 5, &april::TAG16H5),
    set("tag25h9", 5, 35, 9, &april::TAG25H9),
    set("tag36h11", 6, 587, 11, &april::TAG36H11),
    turned("DICT_APRILTAG_16h5", 4, 30, 5, &april::TAG16H5),
    turned("DICT_APRILTAG_25h9", 5, 35, 9, &april::TAG25H9),
    turned("DICT_APRILTAG_36h11", 6, 587, 11, &april::TAG36H11),
];

static SETS: [Dictionary; 23] = ALL;

const fn set(
    name: &'static str,
    side: usize,
    markers: usize,
    distance: usize,
    words: &'static [u64],
) -> Dictionary {
    Dictionary { name, side, markers, distance, words: Words::Table(words) }
}

const fn turned(
    name: &'static str,
    side: usize,
    markers: usize,
    distance: usize,
    words: &'static [u64],
) -> Dictionary {
    Dictionary { name, side, markers, distance, words: Words::Turned(words) }
}

impl PartialEq for Dictionary {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Dictionary {}

impl Dictionary {
    /// The dictionary of a name: OpenCV's, for example `DICT_4X4_50`, or an AprilTag family, `tag36h11`.
    ///
    /// OpenCV prints AprilTags turned by half, so `DICT_APRILTAG_36h11` is not `tag36h11`.
    #[must_use]
    pub fn named(name: &str) -> Option<&'static Self> {
        SETS.iter().find(|set| set.name == name)
    }
    /// All names.
    pub fn names() -> impl Iterator<Item = &'static str> {
        SETS.iter().map(|set| set.name)
    }
    /// Kalibr's tags.
    #[must_use]
    pub fn tag36h11() -> &'static Self {
        &SETS[19]
    }
    /// Its name.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }
    /// Cells of a marker both ways, without the border.
    #[must_use]
    pub const fn side(&self) -> usize {
        self.side
    }
    /// How many markers there are.
    #[must_use]
    pub const fn markers(&self) -> usize {
        self.markers
    }
    /// Misread cells that can be put right for certain.
    #[must_use]
    pub const fn correctable(&self) -> usize {
        self.distance.saturating_sub(1) / 2
    }
    /// Cells of a marker row by row from the upper left, the first one in the highest of side² bits, 1 is white.
    #[must_use]
    pub fn word(&self, marker: usize) -> Option<u64> {
        (marker < self.markers).then(|| match self.words {
            Words::Table(words) => words[marker],
            Words::Turned(words) => words[marker].reverse_bits() >> (64 - self.side * self.side),
            Words::Rows => {
                const ROWS: [u64; 4] = [0b10000, 0b10111, 0b01001, 0b01110];
                (0..5).rev().fold(0, |word, pair| word << 5 | ROWS[marker >> (2 * pair) & 3])
            }
        })
    }
    /// Whether a cell of a marker is white.
    #[must_use]
    pub fn is_white(&self, marker: usize, row: usize, column: usize) -> bool {
        let inside = row < self.side && column < self.side;
        let bit =
            self.side * self.side - 1 - (row.min(self.side - 1) * self.side + column.min(self.side - 1));
        inside && self.word(marker).is_some_and(|word| word >> bit & 1 == 1)
    }
    /// A marker as printed: black with white cells, `border` cells of black around them.
    pub(super) fn ink(&self, marker: usize, at: BoardPoint, side_m: f64, border: usize) -> Vec<Ink> {
        let cell = side_m / (self.side + 2 * border) as f64;
        let mut ink = vec![Ink { shape: Shape::square(at.x_m, at.y_m, side_m), dark: true }];
        for row in 0..self.side {
            let mut column = 0;
            while column < self.side {
                let length = (column..self.side).take_while(|&c| self.is_white(marker, row, c)).count();
                if length > 0 {
                    // One strip for neighbouring cells, so that no seam is drawn between them.
                    let from = BoardPoint {
                        x_m: at.x_m + (border + column) as f64 * cell,
                        y_m: at.y_m + (border + row) as f64 * cell,
                    };
                    let to = BoardPoint { x_m: from.x_m + length as f64 * cell, y_m: from.y_m + cell };
                    ink.push(Ink { shape: Shape::Rectangle { from, to }, dark: false });
                }
                column += length.max(1);
            }
        }
        ink
    }
}

/// The same cells turned by a quarter, clockwise.
pub(in crate::calibration) fn quarter_turned(word: u64, side: usize) -> u64 {
    let last = side * side - 1;
    let mut out = 0;
    for row in 0..side {
        for column in 0..side {
            // What comes here was in the lower left before.
            let from = last - ((side - 1 - column) * side + row);
            out = out << 1 | (word >> from & 1);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distances_are_those_of_the_words() {
        for set in &SETS {
            let turns: Vec<[u64; 4]> = (0..set.markers())
                .filter_map(|marker| set.word(marker))
                .map(|word| {
                    let one = quarter_turned(word, set.side());
                    let two = quarter_turned(one, set.side());
                    [word, one, two, quarter_turned(two, set.side())]
                })
                .collect();
            let mut least = u32::MAX;
            for (i, a) in turns.iter().enumerate() {
                least = (1..4).map(|turn| (a[0] ^ a[turn]).count_ones()).fold(least, u32::min);
                for b in &turns[..i] {
                    least = b.iter().map(|b| (a[0] ^ b).count_ones()).fold(least, u32::min);
                }
            }
            assert_eq!(least as usize, set.distance, "{}", set.name());
        }
    }

    #[test]
    fn words_are_as_printed() {
        let word = |name: &str, marker| Dictionary::named(name).and_then(|set| set.word(marker));
        assert_eq!(word("tag36h11", 0), Some(0xd_5d62_8584));
        assert_eq!(word("DICT_APRILTAG_36h11", 0), Some(0x2_1a14_6bab));
        assert_eq!(word("DICT_4X4_50", 0), Some(0xb532));
        assert_eq!(word("DICT_ARUCO_ORIGINAL", 0), Some(0x108_4210));
        assert_eq!(word("DICT_4X4_50", 50), None);
        assert_eq!(Dictionary::tag36h11().name(), "tag36h11");
    }
}
