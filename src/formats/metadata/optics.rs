//! Focal lengths and lens numbers that photos carry, and the focal length in pixels of the stored size.

use super::draft::Draft;
use super::values::{numbers, quoted};
use crate::camera::{Brown, Camera};

/// Diagonal of the 35 mm film frame, millimetres.
const FILM_DIAGONAL_MM: f64 = 43.266_615_305_567_87;

/// Focal lengths and lens numbers. Pixels are those of the size that the camera wrote, except
/// [`focal_length_px`](Self::focal_length_px).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Optics {
    /// EXIF `FocalLength`, millimetres.
    pub focal_length_mm: Option<f64>,
    /// EXIF `FocalLengthIn35mmFilm`, millimetres.
    pub focal_length_35mm_mm: Option<f64>,
    /// EXIF `FocalPlaneX/YResolution`, pixels per millimetre, its unit applied.
    pub focal_plane_px_mm: Option<[f64; 2]>,
    /// The focal length in pixels of the stored size, by the best of what is below and above.
    pub focal_length_px: Option<FocalLengthPx>,
    /// DJI's calibrated focal length and optical centre.
    pub dji: Option<DjiCalibration>,
    /// DJI's lens: `DewarpData`.
    pub dewarp: Option<Dewarp>,
    /// Pix4D's camera namespace.
    pub pix4d: Option<Pix4dCamera>,
    /// Skydio's calibration.
    pub skydio: Option<SkydioCalibration>,
}

/// A focal length in pixels of the stored image.
#[derive(Debug, Clone, PartialEq)]
pub struct FocalLengthPx {
    /// Along the rows.
    pub x: f64,
    /// Along the columns.
    pub y: f64,
    /// How it was derived.
    pub from: String,
}

/// DJI `CalibratedFocalLength` and `CalibratedOpticalCenterX/Y`; often the model's nominal values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DjiCalibration {
    /// Pixels.
    pub focal_length_px: f64,
    /// Column and row, pixels; which corner or centre they count from is not documented.
    pub optical_centre: Option<(f64, f64)>,
}

/// DJI `DewarpData`: Brown's lens in OpenCV's meaning, for the full-size image before correction.
#[derive(Debug, Clone, PartialEq)]
pub struct Dewarp {
    /// Date of the calibration as written.
    pub date: String,
    /// Focal lengths, pixels.
    pub fx: f64,
    /// Focal lengths, pixels.
    pub fy: f64,
    /// Principal point from the image's middle, pixels to the right.
    pub cx_from_middle: f64,
    /// Principal point from the image's middle, pixels down.
    pub cy_from_middle: f64,
    /// k1, k2, p1, p2, k3.
    pub distortion: [f64; 5],
    /// `DewarpFlag`: true when the stored pixels are corrected already; `None` when the photo does not say.
    pub applied: Option<bool>,
}

impl Dewarp {
    /// `date;fx,fy,cx,cy,k1,k2,p1,p2,k3`.
    ///
    /// # Errors
    /// Words for another count of numbers, or focal lengths that are not positive.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (date, rest) = text.split_once(';').unwrap_or(("", text));
        let values = numbers(rest.trim_end_matches(';'))?;
        let [fx, fy, cx, cy, k1, k2, p1, p2, k3] = values[..] else {
            return Err(format!("{} holds {} numbers instead of 9", quoted(text), values.len()));
        };
        if !(fx > 0.0 && fy > 0.0) {
            return Err(format!("focal lengths {fx} and {fy} are not positive"));
        }
        Ok(Self {
            date: date.trim().chars().take(32).collect(),
            fx,
            fy,
            cx_from_middle: cx,
            cy_from_middle: cy,
            distortion: [k1, k2, p1, p2, k3],
            applied: None,
        })
    }

    /// The camera of the stored pixels: `stored` columns and rows, of a photo that the camera wrote with `written`
    /// ones. Offsets from the middle scale with the size; the middle of w columns is (w - 1) / 2.
    ///
    /// # Errors
    /// Words when the pixels are corrected already (which principal point they have then is not documented), when the
    /// photo was cropped, or when the lens is none.
    pub fn camera(&self, stored: (u32, u32), written: Option<(u32, u32)>) -> Result<Camera, String> {
        if self.applied == Some(true) {
            return Err("DewarpFlag is 1: the stored pixels are corrected already".to_owned());
        }
        let ((w, h), (ew, eh)) = (stored, written.unwrap_or(stored));
        let s = f64::from(w) / f64::from(ew);
        // Sizes of zero make this NaN or infinite.
        let same_shape = (f64::from(h) / f64::from(eh) / s - 1.0).abs() < 0.01;
        if !same_shape {
            return Err(format!(
                "the camera wrote {ew} x {eh} pixels, the file holds {w} x {h}, of another shape"
            ));
        }
        let [k1, k2, p1, p2, k3] = self.distortion;
        let cx = 0.5 * (f64::from(w) - 1.0) + s * self.cx_from_middle;
        let cy = 0.5 * (f64::from(h) - 1.0) + s * self.cy_from_middle;
        let lens = Brown::new([s * self.fx, s * self.fy, 0.0, cx, cy, k1, k2, p1, p2, k3]);
        lens.and_then(|lens| Camera::new(lens, w, h, None)).map_err(|e| e.to_string())
    }
}

/// Pix4D's camera namespace: lens, band and place in a rig, as written.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Pix4dCamera {
    /// "perspective" or "fisheye".
    pub model: Option<String>,
    /// `PerspectiveFocalLength`, millimetres.
    pub focal_length_mm: Option<f64>,
    /// `PerspectiveFocalLength` where its unit is pixels.
    pub focal_length_px: Option<f64>,
    /// Column and row of the principal point, millimetres from the image's corner.
    pub principal_point_mm: Option<[f64; 2]>,
    /// R1, R2, R3, T1, T2.
    pub perspective_distortion: Option<[f64; 5]>,
    /// Coefficients of the fisheye, ascending.
    pub fisheye_polynomial: Vec<f64>,
    /// C, D, E, F of the fisheye's affine matrix.
    pub fisheye_affine: Option<[f64; 4]>,
    /// Names of the bands.
    pub bands: Vec<String>,
    /// Their wavelengths, nanometres.
    pub wavelengths_nm: Vec<f64>,
    /// The rig's name.
    pub rig: Option<String>,
    /// The camera's number in the rig.
    pub rig_camera: Option<String>,
    /// Rotation against the rig's reference camera: ω, φ, κ, degrees.
    pub rig_relatives_deg: Option<[f64; 3]>,
    /// What the photos of one capture share.
    pub capture: Option<String>,
    /// `IMUTimeOffset`, as written.
    pub imu_time_offset: Option<f64>,
    /// `LineReadoutTime` of a rolling shutter, as written.
    pub line_readout_time: Option<f64>,
}

/// Skydio's `CalibratedFocalLength`, `CalibratedOpticalCenter` and `DewarpData`.
#[derive(Debug, Clone, PartialEq)]
pub struct SkydioCalibration {
    /// x and y, pixels.
    pub focal_length_px: [f64; 2],
    /// Column and row, counted from the middle of the top-left pixel: the middle of 4056 columns is given as 2027.5.
    pub optical_centre: Option<[f64; 2]>,
    /// Radial coefficients.
    pub radial: Vec<f64>,
}

pub(super) fn apply(draft: &mut Draft) {
    let optics = &mut draft.out.optics;
    optics.focal_length_mm = draft.exif.focal_length_mm;
    optics.focal_length_35mm_mm = draft.exif.focal_length_35mm_mm;
    optics.focal_plane_px_mm = draft.exif.focal_plane_px_mm;
    let Some((width, height)) = draft.out.stored_size else { return };
    let scale = match (draft.out.exif_size, scale(draft)) {
        (None, _) => 1.0,
        (Some(_), Some(scale)) => scale,
        (Some((w, h)), None) => {
            draft.warn(format!(
                "the EXIF states {w} x {h} pixels, the file holds {width} x {height}, of another shape: it was \
                 cropped, so no focal length in pixels is derived"
            ));
            return;
        }
    };
    if let Some((w, h)) = draft.out.exif_size.filter(|_| (scale - 1.0).abs() > 1e-6) {
        draft.note(format!(
            "the EXIF states {w} x {h} pixels, the file holds {width} x {height}: focal lengths in pixels are scaled \
             by {scale:.4}"
        ));
    }
    let found = focal_length(&draft.out.optics, scale, f64::from(width).hypot(f64::from(height)));
    // Fields of view from 6 to 170 degrees.
    let longest = f64::from(width.max(height));
    draft.out.optics.focal_length_px = match found {
        Some(f) if [f.x, f.y].iter().all(|v| (0.04 * longest..10.0 * longest).contains(v)) => Some(f),
        Some(f) => {
            draft.warn(format!("a focal length of {:.1} pixels ({}) is not believed", f.x, f.from));
            None
        }
        None => None,
    };
}

/// Stored size over EXIF's size, a quarter turn allowed for; `None` when the shapes differ.
fn scale(draft: &Draft) -> Option<f64> {
    let ((w, h), (ew, eh)) = (draft.out.stored_size?, draft.out.exif_size?);
    [(ew, eh), (eh, ew)].into_iter().find_map(|(ew, eh)| {
        let (x, y) = (f64::from(w) / f64::from(ew), f64::from(h) / f64::from(eh));
        ((x / y - 1.0).abs() < 0.01).then_some(x)
    })
}

fn focal_length(optics: &Optics, scale: f64, diagonal_px: f64) -> Option<FocalLengthPx> {
    let px = |x: f64, y: f64, from: &str| Some(FocalLengthPx { x, y, from: from.to_owned() });
    if let Some(d) = &optics.dewarp {
        return px(scale * d.fx, scale * d.fy, "drone-dji:DewarpData");
    }
    if let Some(p) = &optics.pix4d {
        if let Some(f) = p.focal_length_px {
            return px(scale * f, scale * f, "Camera:PerspectiveFocalLength, pixels");
        }
        if let (Some(f), Some([x, y])) = (p.focal_length_mm, optics.focal_plane_px_mm) {
            let from = "Camera:PerspectiveFocalLength times EXIF FocalPlaneResolution";
            return px(scale * f * x, scale * f * y, from);
        }
    }
    if let Some(s) = &optics.skydio {
        let [x, y] = s.focal_length_px;
        return px(scale * x, scale * y, "drone-skydio:CalibratedFocalLength");
    }
    if let Some(d) = optics.dji {
        return px(scale * d.focal_length_px, scale * d.focal_length_px, "drone-dji:CalibratedFocalLength");
    }
    if let (Some(f), Some([x, y])) = (optics.focal_length_mm, optics.focal_plane_px_mm) {
        return px(scale * f * x, scale * f * y, "EXIF FocalLength times FocalPlaneResolution");
    }
    let f = optics.focal_length_35mm_mm? * diagonal_px / FILM_DIAGONAL_MM;
    px(
        f,
        f,
        "EXIF FocalLengthIn35mmFilm by the diagonal: too short when the photo is a part of the sensor (16:9)",
    )
}
