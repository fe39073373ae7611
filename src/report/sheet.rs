//! Calibration targets as sheets to print: SVG and PDF in true size.

use crate::calibration::{BoardPoint, Shape, Target};
use pdf_writer::{Content, Finish, Name, Pdf, Rect, Ref, Str};
use std::fmt::Write as _;

/// White around the target, and the paper's margin that printers leave empty, millimetres.
const MARGIN_MM: f64 = 10.0;
/// Height of the line of text and the scale bar below the target, millimetres.
const FOOT_MM: f64 = 16.0;
const POINTS_PER_MM: f64 = 72.0 / 25.4;
/// A circle's quarter as a cubic curve: distance of the control points in radii.
const QUARTER: f64 = 0.552_284_749_830_793_4;

/// Paper of a standard size; sheets lie with the long side along the target's.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Paper {
    /// Name, in capitals.
    pub name: &'static str,
    /// Short side, millimetres.
    pub short_mm: u32,
    /// Long side, millimetres.
    pub long_mm: u32,
}

/// Standard sizes from small to large: ISO 216 A5 to A0, with the North American sizes in their places.
pub const PAPERS: [Paper; 8] = [
    Paper { name: "A5", short_mm: 148, long_mm: 210 },
    Paper { name: "LETTER", short_mm: 216, long_mm: 279 },
    Paper { name: "A4", short_mm: 210, long_mm: 297 },
    Paper { name: "TABLOID", short_mm: 279, long_mm: 432 },
    Paper { name: "A3", short_mm: 297, long_mm: 420 },
    Paper { name: "A2", short_mm: 420, long_mm: 594 },
    Paper { name: "A1", short_mm: 594, long_mm: 841 },
    Paper { name: "A0", short_mm: 841, long_mm: 1189 },
];

/// Why a target cannot be printed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SheetError {
    /// No paper of this name.
    #[error("there is no paper \"{name}\"; known are A5, A4, A3, A2, A1, A0, LETTER, TABLOID")]
    UnknownPaper {
        /// What was asked for.
        name: String,
    },
    /// Target and margin are larger than the paper.
    #[error("the target with its margin needs {width_mm:.0} × {height_mm:.0} mm: more than {paper}")]
    TooLarge {
        /// Width needed.
        width_mm: f64,
        /// Height needed.
        height_mm: f64,
        /// Name of the paper.
        paper: String,
    },
}

/// A target on its paper.
#[derive(Debug, Clone)]
pub struct Sheet {
    target: Target,
    title: String,
    paper: Paper,
    /// Width and height of the paper as the target lies on it.
    size_mm: (f64, f64),
    /// Where the board's origin lies on the paper, from its upper left corner.
    origin_mm: (f64, f64),
    /// Lower end of what is printed.
    bottom_mm: f64,
}

impl Sheet {
    /// Lays a target on a paper.
    ///
    /// - `title`: one line that says what it is, printed below it.
    /// - `paper`: a name of [`PAPERS`] in any case; the smallest ISO size that holds the target when `None`.
    ///
    /// # Errors
    /// [`SheetError`].
    pub fn new(target: Target, title: String, paper: Option<&str>) -> Result<Self, SheetError> {
        let (from, to) = bounds(&target);
        let (width, height) = (1e3 * (to.x_m - from.x_m), 1e3 * (to.y_m - from.y_m));
        let needed = (width + 2.0 * MARGIN_MM, height + 2.0 * MARGIN_MM + FOOT_MM);
        let laid = |paper: &Paper| {
            let (short, long) = (f64::from(paper.short_mm), f64::from(paper.long_mm));
            let size = if needed.0 > needed.1 { (long, short) } else { (short, long) };
            (needed.0 <= size.0 && needed.1 <= size.1).then_some(size)
        };
        let too_large = |paper: &str| SheetError::TooLarge {
            width_mm: needed.0,
            height_mm: needed.1,
            paper: paper.to_owned(),
        };
        let (paper, size_mm) = match paper {
            Some(name) => {
                let paper = PAPERS.iter().find(|p| p.name.eq_ignore_ascii_case(name));
                let paper = paper.ok_or_else(|| SheetError::UnknownPaper { name: name.to_owned() })?;
                (*paper, laid(paper).ok_or_else(|| too_large(paper.name))?)
            }
            None => PAPERS
                .iter()
                .filter(|paper| paper.name.starts_with('A'))
                .find_map(|paper| laid(paper).map(|size| (*paper, size)))
                .ok_or_else(|| too_large("A0"))?,
        };
        let left = 0.5 * (size_mm.0 - width);
        let top = 0.5 * (size_mm.1 - FOOT_MM - height);
        let origin_mm = (left - 1e3 * from.x_m, top - 1e3 * from.y_m);
        Ok(Self { target, title, paper, size_mm, origin_mm, bottom_mm: top + height })
    }

    /// The paper.
    #[must_use]
    pub const fn paper(&self) -> Paper {
        self.paper
    }

    fn place(&self, p: BoardPoint) -> (f64, f64) {
        (self.origin_mm.0 + 1e3 * p.x_m, self.origin_mm.1 + 1e3 * p.y_m)
    }

    /// A bar by which a ruler tells whether the printer kept the size: its left end and length, millimetres.
    fn scale_bar(&self) -> (f64, f64) {
        let length = if self.size_mm.0 >= 140.0 { 100.0 } else { 50.0 };
        (self.size_mm.0 - MARGIN_MM - length, length)
    }

    /// What the line below the target says.
    fn words(&self) -> String {
        format!("{}. Print at 100 %: the bar is {} mm long.", self.title, self.scale_bar().1)
    }

    /// As SVG; one user unit is a millimetre.
    #[must_use]
    pub fn svg(&self) -> String {
        let (width, height) = self.size_mm;
        let mut svg = format!(
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<svg xmlns=\"http://www.w3.org/2000/svg\" \
             width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\" \
             shape-rendering=\"geometricPrecision\">\n<title>{}</title>\n\
             <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n",
            escaped(&self.title)
        );
        // Writing into a String cannot fail.
        for ink in self.target.ink() {
            let fill = if ink.dark { "#000" } else { "#fff" };
            let _ = match ink.shape {
                Shape::Rectangle { from, to } => {
                    let ((x, y), (right, bottom)) = (self.place(from), self.place(to));
                    writeln!(
                        svg,
                        "<rect x=\"{x:.4}\" y=\"{y:.4}\" width=\"{:.4}\" height=\"{:.4}\" fill=\"{fill}\"/>",
                        right - x,
                        bottom - y
                    )
                }
                Shape::Disc { centre, radius_m } => {
                    let (x, y) = self.place(centre);
                    let r = 1e3 * radius_m;
                    writeln!(svg, "<circle cx=\"{x:.4}\" cy=\"{y:.4}\" r=\"{r:.4}\" fill=\"{fill}\"/>")
                }
            };
        }
        let (left, length) = self.scale_bar();
        let foot = self.bottom_mm + MARGIN_MM;
        let _ = write!(
            svg,
            "<text x=\"{MARGIN_MM}\" y=\"{:.4}\" font-family=\"Helvetica, Arial, sans-serif\" \
             font-size=\"2.8\">{}</text>\n<path d=\"M{left:.4} {:.4}v3h{length}v-3\" fill=\"none\" stroke=\"#000\" \
             stroke-width=\"0.2\"/>\n</svg>\n",
            foot + 7.0,
            escaped(&self.words()),
            foot,
        );
        svg
    }

    /// As PDF.
    #[must_use]
    pub fn pdf(&self) -> Vec<u8> {
        let [catalog, pages, page, font, content] = [1, 2, 3, 4, 5].map(Ref::new);
        let points = |mm: f64| (mm * POINTS_PER_MM) as f32;
        let up = |mm: f64| points(self.size_mm.1 - mm);
        let mut drawing = Content::new();
        for ink in self.target.ink() {
            drawing.set_fill_gray(if ink.dark { 0.0 } else { 1.0 });
            match ink.shape {
                Shape::Rectangle { from, to } => {
                    let ((x, y), (right, bottom)) = (self.place(from), self.place(to));
                    drawing.rect(points(x), up(bottom), points(right - x), points(bottom - y));
                }
                Shape::Disc { centre, radius_m } => {
                    let ((x, y), r) = (self.place(centre), 1e3 * radius_m);
                    let at = |right: f64, down: f64| (points(x + right * r), up(y + down * r));
                    let (x0, y0) = at(1.0, 0.0);
                    drawing.move_to(x0, y0);
                    for (c, s) in [(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)] {
                        // From the direction (c, s) to the one a quarter further, (−s, c).
                        let (x1, y1) = at(c - QUARTER * s, s + QUARTER * c);
                        let (x2, y2) = at(-s + QUARTER * c, c + QUARTER * s);
                        let (x3, y3) = at(-s, c);
                        drawing.cubic_to(x1, y1, x2, y2, x3, y3);
                    }
                    drawing.close_path();
                }
            }
            drawing.fill_nonzero();
        }
        let (left, length) = self.scale_bar();
        let foot = self.bottom_mm + MARGIN_MM;
        drawing.set_line_width(0.5);
        drawing.move_to(points(left), up(foot));
        drawing.line_to(points(left), up(foot + 3.0));
        drawing.line_to(points(left + length), up(foot + 3.0));
        drawing.line_to(points(left + length), up(foot));
        drawing.stroke();
        drawing.set_fill_gray(0.0);
        drawing.begin_text();
        drawing.set_font(Name(b"Label"), 8.0);
        drawing.next_line(points(MARGIN_MM), up(foot + 7.0));
        drawing.show(Str(&latin_1(&self.words())));
        drawing.end_text();

        let mut pdf = Pdf::new();
        pdf.catalog(catalog).pages(pages);
        pdf.pages(pages).kids([page]).count(1);
        let mut sheet = pdf.page(page);
        sheet.media_box(Rect::new(0.0, 0.0, points(self.size_mm.0), points(self.size_mm.1)));
        sheet.parent(pages).contents(content);
        sheet.resources().fonts().pair(Name(b"Label"), font);
        sheet.finish();
        pdf.type1_font(font).base_font(Name(b"Helvetica")).encoding_predefined(Name(b"WinAnsiEncoding"));
        pdf.stream(content, &drawing.finish());
        pdf.finish()
    }
}

/// Upper left and lower right corners of what is printed.
fn bounds(target: &Target) -> (BoardPoint, BoardPoint) {
    let mut from = BoardPoint { x_m: f64::INFINITY, y_m: f64::INFINITY };
    let mut to = BoardPoint { x_m: f64::NEG_INFINITY, y_m: f64::NEG_INFINITY };
    for ink in target.ink() {
        let (a, b) = ink.shape.bounds();
        from = BoardPoint { x_m: from.x_m.min(a.x_m), y_m: from.y_m.min(a.y_m) };
        to = BoardPoint { x_m: to.x_m.max(b.x_m), y_m: to.y_m.max(b.y_m) };
    }
    (from, to)
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// The text in the single-byte encoding of the standard fonts; `?` for what that does not have.
fn latin_1(text: &str) -> Vec<u8> {
    text.chars().map(|c| u8::try_from(u32::from(c)).unwrap_or(b'?')).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibration::SquaresTarget;

    fn sheet(paper: Option<&str>) -> Result<Sheet, SheetError> {
        let target = Target::Squares(SquaresTarget::paper());
        Sheet::new(target, "7 × 7 squares & <gaps>".to_owned(), paper)
    }

    #[test]
    fn the_papers_target_needs_a3_and_lies_on_it_in_true_size() {
        // 13 × 15.7 mm = 204.1 mm with margins is wider than A4's 210 mm.
        let made = sheet(None).unwrap();
        assert_eq!(made.paper().name, "A3");
        let svg = made.svg();
        assert!(svg.contains("width=\"297mm\" height=\"420mm\" viewBox=\"0 0 297 420\""), "{svg}");
        assert_eq!(svg.matches("width=\"15.7000\" height=\"15.7000\" fill=\"#000\"").count(), 49);
        assert_eq!(svg.matches("width=\"7.8500\" height=\"7.8500\" fill=\"#fff\"").count(), 1);
        // Centred from side to side.
        assert!(svg.contains(&format!("x=\"{:.4}\"", 0.5 * (297.0 - 204.1))), "{svg}");
        assert!(svg.contains("7 × 7 squares &amp; &lt;gaps&gt;"));
    }

    #[test]
    fn the_pdf_has_the_papers_size_and_one_rectangle_per_square() {
        let pdf = String::from_utf8_lossy(&sheet(Some("a3")).unwrap().pdf()).into_owned();
        assert!(pdf.starts_with("%PDF-1."), "{}", &pdf[..20]);
        assert!(pdf.contains("/MediaBox [0 0 841.88"), "{pdf}");
        assert_eq!(pdf.matches(" re\nf\n").count(), 50, "{pdf}");
    }

    #[test]
    fn what_does_not_fit_is_refused_with_its_size() {
        let said = sheet(Some("A4")).unwrap_err().to_string();
        assert_eq!(said, "the target with its margin needs 224 × 240 mm: more than A4");
        assert!(matches!(sheet(Some("B4")), Err(SheetError::UnknownPaper { .. })));
    }
}
