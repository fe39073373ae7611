//! `[calibrate.target]`: the planar target in the photos.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::error::{ConfigError, Resolver};
use super::quantity::Length;
use super::source::Located;

/// The kind of calibration target.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TargetKind {
    /// Separate black squares on white, in rows and columns: the paper's target. Takes `square`, `gap`, `hollow`.
    Squares,
    /// A chessboard, counted by its inner corners. Takes `square`.
    Chessboard,
    /// A chessboard with ArUco markers in its white squares, counted by squares. Takes `square`, `marker`,
    /// `dictionary`, `first_marker`, `legacy`.
    Charuco,
    /// AprilTags in rows and columns, as Kalibr prints them. Takes `tag`, `gap`, `dictionary`, `first_marker`, `first_tag`,
    /// `border_cells`, `joints`.
    Aprilgrid,
    /// Black discs in rows and columns. Takes `spacing`, `diameter`.
    Circles,
    /// Black discs of which every second row is moved by `spacing`. Takes `spacing` (between rows), `diameter`.
    AsymmetricCircles,
}

impl TargetKind {
    /// As written in the pipeline file.
    pub fn name(self) -> &'static str {
        match self {
            Self::Squares => "squares",
            Self::Chessboard => "chessboard",
            Self::Charuco => "charuco",
            Self::Aprilgrid => "aprilgrid",
            Self::Circles => "circles",
            Self::AsymmetricCircles => "asymmetric_circles",
        }
    }

    /// The keys it takes beside `kind`, `rows` and `columns`: those it needs, then those it may have.
    fn keys(self) -> (&'static [&'static str], &'static [&'static str]) {
        match self {
            Self::Squares => (&["square", "gap", "hollow"], &[]),
            Self::Chessboard => (&["square"], &[]),
            Self::Charuco => (&["square", "marker", "dictionary"], &["first_marker", "legacy"]),
            Self::Aprilgrid => {
                (&["tag", "gap"], &["dictionary", "first_marker", "first_tag", "border_cells", "joints"])
            }
            Self::Circles | Self::AsymmetricCircles => (&["spacing", "diameter"], &[]),
        }
    }

    /// What `rows` and `columns` count.
    fn unit(self) -> &'static str {
        match self {
            Self::Squares | Self::Charuco => "squares",
            Self::Chessboard => "inner corners",
            Self::Aprilgrid => "tags",
            Self::Circles | Self::AsymmetricCircles => "circles",
        }
    }
}

/// Which square of the target is drawn as an outline, to tell the target's orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum HollowSquare {
    /// The upper-left square is hollow, as on the paper's target.
    UpperLeft,
    /// All squares are filled: the target's orientation is then ambiguous by half a turn (or a quarter, when square).
    None,
}

/// Where the first of an aprilgrid's tags is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum FirstTag {
    /// As Kalibr prints them.
    LowerLeft,
    /// As text is read.
    UpperLeft,
}

/// `[calibrate.target]`: the target in the photos.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct TargetSpec {
    /// Kind of target.
    pub kind: TargetKind,
    /// Number of rows of squares (chessboard: of inner corners; aprilgrid: of tags; circles: of circles). Left out:
    /// counted in the photos.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rows: Option<Located<u32>>,
    /// Number of columns of the same. Give both or none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub columns: Option<Located<u32>>,
    /// Side of a square.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub square: Option<Located<Length>>,
    /// Space between neighbouring squares or tags (their pitch is `square` or `tag`, plus `gap`).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gap: Option<Located<Length>>,
    /// Which square is hollow.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hollow: Option<Located<HollowSquare>>,
    /// Side of a ChArUco marker, its black border included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub marker: Option<Located<Length>>,
    /// Side of an AprilTag, its black border included.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub tag: Option<Located<Length>>,
    /// Dictionary of the markers: OpenCV's name, "DICT_4X4_50" and so on, or an AprilTag family, "tag36h11", which is an
    /// aprilgrid's default. (OpenCV draws AprilTags turned by half: its "DICT_APRILTAG_36h11" is not "tag36h11".)
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dictionary: Option<Located<String>>,
    /// Number of the first marker. Default 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_marker: Option<Located<u32>>,
    /// Whether a ChArUco board of an even number of rows starts with a white square, as OpenCV before 4.6 printed it.
    /// Default false.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub legacy: Option<Located<bool>>,
    /// Where an aprilgrid's first tag is; the others follow to the right, then row by row. Default "lower_left".
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_tag: Option<Located<FirstTag>>,
    /// Cells of black around an aprilgrid's tags: 2 as Kalibr prints them (default), 1 as AprilTag does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub border_cells: Option<Located<u32>>,
    /// Whether small black squares join the corners of an aprilgrid's tags, as Kalibr prints them. Default true.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<Located<bool>>,
    /// Distance between rows of circles.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub spacing: Option<Located<Length>>,
    /// Diameter of a circle.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diameter: Option<Located<Length>>,
}

impl TargetSpec {
    /// Nothing but the kind.
    pub fn of_kind(kind: TargetKind) -> Self {
        Self {
            kind,
            rows: None,
            columns: None,
            square: None,
            gap: None,
            hollow: None,
            marker: None,
            tag: None,
            dictionary: None,
            first_marker: None,
            first_tag: None,
            border_cells: None,
            legacy: None,
            joints: None,
            spacing: None,
            diameter: None,
        }
    }

    /// Optional keys and their places in the file, where given.
    fn given(&self) -> [(&'static str, Option<Located<()>>); 13] {
        fn place<T>(value: &Option<Located<T>>) -> Option<Located<()>> {
            value.as_ref().map(|v| Located { value: (), span: v.span.clone() })
        }
        [
            ("square", place(&self.square)),
            ("gap", place(&self.gap)),
            ("hollow", place(&self.hollow)),
            ("marker", place(&self.marker)),
            ("tag", place(&self.tag)),
            ("dictionary", place(&self.dictionary)),
            ("first_marker", place(&self.first_marker)),
            ("first_tag", place(&self.first_tag)),
            ("border_cells", place(&self.border_cells)),
            ("legacy", place(&self.legacy)),
            ("joints", place(&self.joints)),
            ("spacing", place(&self.spacing)),
            ("diameter", place(&self.diameter)),
        ]
    }

    /// The target, or what is wrong with its description: at which key (none: as a whole), and what.
    ///
    /// # Errors
    /// A key that the kind needs is missing, one that it does not take is given, or a number is no target's.
    pub fn resolve(&self) -> Result<Target, TargetFault> {
        let (needed, optional) = self.kind.keys();
        for (key, place) in self.given() {
            match place {
                Some(place) if !needed.contains(&key) && !optional.contains(&key) => {
                    let all: Vec<&str> = needed.iter().chain(optional).copied().collect();
                    return Err(TargetFault {
                        place: Some(place),
                        what: format!(
                            "`{key}` would not be used: {} takes {}",
                            self.kind.name(),
                            all.join(", ")
                        ),
                    });
                }
                None if needed.contains(&key) => {
                    let what = format!("a target of kind \"{}\" needs `{key}`", self.kind.name());
                    return Err(TargetFault { place: None, what });
                }
                _ => {}
            }
        }
        let count = |name: &str, count: &Option<Located<u32>>| match count {
            Some(n) if n.value < 2 => Err(TargetFault {
                place: Some(Located { value: (), span: n.span.clone() }),
                what: format!("a target needs 2 or more {name} of {}, not {}", self.kind.unit(), n.value),
            }),
            _ => Ok(()),
        };
        count("rows", &self.rows)?;
        count("columns", &self.columns)?;
        let size = match (&self.rows, &self.columns) {
            (Some(rows), Some(columns)) => Some((rows.value, columns.value)),
            (None, None) => None,
            (Some(given), None) | (None, Some(given)) => {
                return Err(TargetFault {
                    place: Some(Located { value: (), span: given.span.clone() }),
                    what: "give both `rows` and `columns`, or neither to have them counted".to_owned(),
                });
            }
        };
        let length = |name: &str, value: &Option<Located<Length>>| match value {
            Some(v) if v.metres().is_finite() && v.metres() > 0.0 => Ok(v.metres()),
            Some(v) => Err(TargetFault {
                place: Some(Located { value: (), span: v.span.clone() }),
                what: format!("`{name}` is {} m; it must be above 0", v.metres()),
            }),
            None => Err(TargetFault { place: None, what: format!("`{name}` is missing") }),
        };
        let first_marker = self.first_marker.as_ref().map_or(0, |first| first.value);
        let dictionary = |fallback: &str| {
            self.dictionary.clone().unwrap_or_else(|| Located::unplaced(fallback.to_owned()))
        };
        let pattern = match self.kind {
            TargetKind::Squares => Pattern::Squares {
                square_m: length("square", &self.square)?,
                gap_m: length("gap", &self.gap)?,
                hollow: self.hollow.as_ref().map_or(HollowSquare::None, |hollow| hollow.value),
            },
            TargetKind::Chessboard => Pattern::Chessboard { square_m: length("square", &self.square)? },
            TargetKind::Charuco => Pattern::Charuco {
                square_m: length("square", &self.square)?,
                marker_m: length("marker", &self.marker)?,
                dictionary: dictionary("").value,
                first_marker,
                legacy: self.legacy.as_ref().is_some_and(|legacy| legacy.value),
            },
            TargetKind::Aprilgrid => Pattern::AprilGrid {
                tag_m: length("tag", &self.tag)?,
                gap_m: length("gap", &self.gap)?,
                dictionary: dictionary("tag36h11").value,
                first_marker,
                first_tag: self.first_tag.as_ref().map_or(FirstTag::LowerLeft, |first| first.value),
                border_cells: self.border_cells.as_ref().map_or(2, |cells| cells.value),
                joints: self.joints.as_ref().is_none_or(|joints| joints.value),
            },
            TargetKind::Circles | TargetKind::AsymmetricCircles => Pattern::Circles {
                spacing_m: length("spacing", &self.spacing)?,
                diameter_m: length("diameter", &self.diameter)?,
                asymmetric: self.kind == TargetKind::AsymmetricCircles,
            },
        };
        Ok(Target { pattern, size })
    }
}

/// What is wrong with the description of a target.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetFault {
    /// The key at fault; none when the description as a whole is.
    pub place: Option<Located<()>>,
    /// What is wrong.
    pub what: String,
}

/// The target in the photos, resolved.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    /// What is printed.
    pub pattern: Pattern,
    /// Rows and columns; to be counted in the photos when not given.
    pub size: Option<(u32, u32)>,
}

/// What is printed on a target, apart from the number of rows and columns. Lengths in metres.
#[derive(Debug, Clone, PartialEq)]
pub enum Pattern {
    /// Separated black squares.
    Squares {
        /// Side of a square.
        square_m: f64,
        /// Space between neighbours.
        gap_m: f64,
        /// Which square is hollow.
        hollow: HollowSquare,
    },
    /// A chessboard.
    Chessboard {
        /// Side of a square.
        square_m: f64,
    },
    /// A chessboard with markers.
    Charuco {
        /// Side of a square.
        square_m: f64,
        /// Side of a marker.
        marker_m: f64,
        /// Name of the markers' dictionary.
        dictionary: String,
        /// Number of the first marker.
        first_marker: u32,
        /// Old layout.
        legacy: bool,
    },
    /// AprilTags in rows and columns.
    AprilGrid {
        /// Side of a tag.
        tag_m: f64,
        /// Space between neighbours.
        gap_m: f64,
        /// Name of the tags' dictionary.
        dictionary: String,
        /// Number of the first tag.
        first_marker: u32,
        /// Where the first tag is.
        first_tag: FirstTag,
        /// Cells of a tag's black border.
        border_cells: u32,
        /// Black squares between the corners of tags.
        joints: bool,
    },
    /// Discs.
    Circles {
        /// Distance between rows.
        spacing_m: f64,
        /// Diameter of a disc.
        diameter_m: f64,
        /// Every second row moved.
        asymmetric: bool,
    },
}

pub(super) fn resolve(spec: &Located<TargetSpec>, resolver: &Resolver) -> Result<Target, ConfigError> {
    spec.resolve().map_err(|fault| match fault.place {
        Some(place) => resolver.error(&place, fault.what),
        None => resolver.error(spec, fault.what),
    })
}
