//! Signs that a viewer turned a photo's pixels after the camera wrote them.
//!
//! Viewers that turn a JPEG rewrite its pixels and set Orientation to 1: nothing says by how much any more. Width and
//! height that are swapped against EXIF's own give a quarter turn away; a half turn leaves only the viewer's name.

use super::draft::Draft;

/// What the file gives away.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case", tag = "kind", content = "program")]
pub enum TurnEvidence {
    /// Width and height are swapped against what the camera wrote: turned by 90° or 270°.
    QuarterTurn,
    /// Rewritten by a viewer that turns pixels, with the shape kept: perhaps turned by 180°. Holds the viewer's name.
    PerhapsHalfTurn(String),
}

/// Viewers and editors that people turn photos with, lower case. (Apple's Photos is "Photos 3.0" and the like.)
const VIEWERS: [&str; 22] = [
    "windows photo viewer",
    "windows photo gallery",
    "windows live photo gallery",
    "microsoft photo",
    "microsoft windows",
    "windows photo editor",
    "paint",
    "picasa",
    "irfanview",
    "xnview",
    "faststone",
    "acdsee",
    "iphoto",
    "aperture",
    "apple photos",
    "macos preview",
    "preview",
    "gthumb",
    "shotwell",
    "digikam",
    "gimp",
    "photoshop",
];

pub(super) fn apply(draft: &mut Draft) {
    let orientation = draft.out.orientation;
    if let (Some((w, h)), Some((ew, eh))) = (draft.out.stored_size, draft.out.exif_size)
        && ew != eh
        && (w > h) != (ew > eh)
        && w != h
    {
        draft.warn(format!(
            "the stored pixels were turned by 90° or 270°: the camera wrote {ew} x {eh}, the file holds {w} x {h}"
        ));
        draft.out.turned = Some(TurnEvidence::QuarterTurn);
        return;
    }
    let Some(program) =
        [&draft.out.creator_tool, &draft.out.software].into_iter().flatten().find(|p| is_viewer(p))
    else {
        return;
    };
    let program = program.clone();
    let later = match (draft.exif.changed, draft.out.times.civil) {
        (Some(changed), Some(taken)) if changed - taken.time.get() >= 60.0 => {
            format!(", {:.0} minutes after it was taken", (changed - taken.time.get()) / 60.0)
        }
        _ => String::new(),
    };
    let orientation = orientation.map_or_else(|| "absent".to_owned(), |o| o.to_string());
    draft.warn(format!(
        "the stored pixels may have been turned by 180°: Orientation is {orientation} and the file was rewritten by \
         {program}{later}"
    ));
    draft.out.turned = Some(TurnEvidence::PerhapsHalfTurn(program));
}

fn is_viewer(program: &str) -> bool {
    let program = program.to_ascii_lowercase();
    // Lightroom develops raw photos, which is no sign of a turn.
    let names_one = VIEWERS.iter().any(|v| program.contains(v)) && !program.contains("lightroom");
    names_one || program.starts_with("photos ")
}
