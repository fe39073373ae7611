//! The container: eight bytes of time before each MAVLink 1 or 2 frame; found again after damage.
//!
//! Why no crate: `mavlink` 0.21 generates and compiles whole dialects (a minute of one core for ArduPilot's) where
//! thirteen messages are read, and reads a stream of frames, not the times between them.
//!
//! # Source
//! MAVLink "Serialization" (mavlink.io/en/guide/serialization.html); `CRC_EXTRA` and lengths from `common.xml` and
//! `ardupilotmega.xml`.

use super::super::autopilot::{Quarantine, array_at};

const STAMP: usize = 8;
/// Payloads are filled up with zeros to this length, as MAVLink 2 cuts trailing zeros off.
const PAYLOAD: usize = 255;
/// Frames that must follow one another before a place after damage is trusted.
const CHAIN: usize = 3;

/// The messages that are read: id, `CRC_EXTRA`, least length in MAVLink 1.
const KNOWN: [(u32, u8, usize); 13] = [
    (0, 50, 9),      // HEARTBEAT
    (2, 137, 12),    // SYSTEM_TIME
    (24, 24, 30),    // GPS_RAW_INT
    (30, 39, 28),    // ATTITUDE
    (31, 246, 32),   // ATTITUDE_QUATERNION
    (33, 104, 28),   // GLOBAL_POSITION_INT
    (112, 174, 12),  // CAMERA_TRIGGER
    (132, 85, 14),   // DISTANCE_SENSOR
    (158, 134, 14),  // MOUNT_STATUS
    (180, 52, 45),   // CAMERA_FEEDBACK
    (263, 133, 255), // CAMERA_IMAGE_CAPTURED
    (265, 26, 16),   // MOUNT_ORIENTATION
    (285, 137, 40),  // GIMBAL_DEVICE_ATTITUDE_STATUS
];

/// A frame of a message that is read.
#[derive(Debug, Clone, Copy)]
pub(super) struct Frame<'a> {
    /// Number of the frame in the file, from 1.
    pub(super) place: u64,
    /// When the ground station received it, µs since 1970.
    pub(super) received_us: u64,
    pub(super) system: u8,
    pub(super) component: u8,
    pub(super) id: u32,
    payload: &'a [u8],
}

impl Frame<'_> {
    /// `N` bytes of the payload; what was cut off the end is zero.
    fn array<const N: usize>(&self, at: usize) -> [u8; N] {
        std::array::from_fn(|i| self.payload.get(at + i).copied().unwrap_or(0))
    }
    pub(super) fn u8(&self, at: usize) -> u8 {
        self.array::<1>(at)[0]
    }
    pub(super) fn i8(&self, at: usize) -> i8 {
        i8::from_le_bytes(self.array(at))
    }
    pub(super) fn u16(&self, at: usize) -> u16 {
        u16::from_le_bytes(self.array(at))
    }
    pub(super) fn i16(&self, at: usize) -> i16 {
        i16::from_le_bytes(self.array(at))
    }
    pub(super) fn u32(&self, at: usize) -> u32 {
        u32::from_le_bytes(self.array(at))
    }
    pub(super) fn i32(&self, at: usize) -> i32 {
        i32::from_le_bytes(self.array(at))
    }
    pub(super) fn u64(&self, at: usize) -> u64 {
        u64::from_le_bytes(self.array(at))
    }
    pub(super) fn f32(&self, at: usize) -> f64 {
        f64::from(f32::from_le_bytes(self.array(at)))
    }
    /// Four numbers of a quaternion.
    pub(super) fn quaternion(&self, at: usize) -> [f64; 4] {
        std::array::from_fn(|i| self.f32(at + 4 * i))
    }
    /// Text up to the first zero.
    pub(super) fn text(&self, at: usize, length: usize) -> String {
        let bytes: Vec<u8> = (at..at + length).map(|i| self.u8(i)).take_while(|b| *b != 0).collect();
        String::from_utf8_lossy(&bytes).into_owned()
    }
}

/// The CRC-16/MCRF4XX of MAVLink.
fn crc(bytes: &[u8], extra: u8) -> u16 {
    bytes.iter().chain(std::iter::once(&extra)).fold(0xFFFF, |crc, byte| {
        let mixed = byte ^ (crc & 0xFF) as u8;
        let mixed = u16::from(mixed ^ (mixed << 4));
        (crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4)
    })
}

/// A frame's parts by its header alone.
struct Head {
    system: u8,
    component: u8,
    id: u32,
    /// From the start of the frame.
    payload: usize,
    length: usize,
    /// With stamp, checksum and signature, from the start of the stamp.
    whole: usize,
}

/// The header of the frame whose stamp lies here, when it fits into the file.
fn head_at(bytes: &[u8], at: usize) -> Option<Head> {
    let [magic, length] = array_at(bytes, at + STAMP)?;
    let frame = at + STAMP;
    let length = usize::from(length);
    let head = match magic {
        0xFE => {
            let [system, component, id] = array_at(bytes, frame + 3)?;
            Head { system, component, id: u32::from(id), payload: 6, length, whole: STAMP + 6 + length + 2 }
        }
        0xFD => {
            let [flags, _, _, system, component, a, b, c] = array_at(bytes, frame + 2)?;
            let signature = if flags & 1 == 0 { 0 } else { 13 };
            let id = u32::from_le_bytes([a, b, c, 0]);
            Head { system, component, id, payload: 10, length, whole: STAMP + 10 + length + 2 + signature }
        }
        _ => return None,
    };
    (at + head.whole <= bytes.len()).then_some(head)
}

/// What is known about the frame at a place by its checksum: `Some(true)` good, `Some(false)` bad, `None` not read.
fn checked(bytes: &[u8], at: usize, head: &Head) -> Option<bool> {
    let (_, extra, least) = KNOWN.iter().find(|(id, ..)| *id == head.id)?;
    let frame = &bytes[at + STAMP..];
    let end = head.payload + head.length;
    let stated = array_at(frame, end).map(u16::from_le_bytes)?;
    let long_enough = head.payload == 10 || head.length >= *least;
    Some(long_enough && crc(&frame[1..end], *extra) == stated)
}

/// Whether frames follow one another from here on, none of them with a wrong checksum.
fn chain_at(bytes: &[u8], at: usize) -> bool {
    let mut at = at;
    for _ in 0..CHAIN {
        match head_at(bytes, at) {
            Some(head) if checked(bytes, at, &head) != Some(false) => at += head.whole,
            _ => return false,
        }
        if at == bytes.len() {
            return true;
        }
    }
    true
}

/// Visits the frames of messages that are read, in the file's order; damage is set aside and skipped. Gives the number
/// of frames.
pub(super) fn walk<'a>(
    bytes: &'a [u8],
    quarantine: &mut Quarantine,
    mut visit: impl FnMut(Frame<'a>),
) -> u64 {
    let (mut at, mut place) = (0, 0);
    while at < bytes.len() {
        let head = head_at(bytes, at);
        let next = head.as_ref().map_or(at, |h| at + h.whole);
        let follows = next == bytes.len() || head_at(bytes, next).is_some();
        let good = head.as_ref().and_then(|h| checked(bytes, at, h));
        // A good checksum settles it; of other frames only the next header tells that the length is right.
        let Some(head) = head.filter(|_| good == Some(true) || follows) else {
            let resumed = (at + 1..bytes.len()).find(|i| chain_at(bytes, *i)).unwrap_or(bytes.len());
            quarantine.add(place + 1, format!("{} bytes at byte {at} are no MAVLink frame", resumed - at));
            at = resumed;
            continue;
        };
        place += 1;
        match good {
            Some(true) => {
                let start = at + STAMP + head.payload;
                visit(Frame {
                    place,
                    received_us: array_at(bytes, at).map_or(0, u64::from_be_bytes),
                    system: head.system,
                    component: head.component,
                    id: head.id,
                    payload: &bytes[start..start + head.length.min(PAYLOAD)],
                });
            }
            Some(false) => {
                quarantine.add(place, format!("message {} at byte {at} has a wrong checksum", head.id));
            }
            None => {}
        }
        at = next;
    }
    place
}

/// Seals a payload into a stamped MAVLink 2 frame.
#[cfg(test)]
pub(super) fn sealed(received_us: u64, (system, component): (u8, u8), id: u32, payload: &[u8]) -> Vec<u8> {
    let kept = payload.iter().rposition(|b| *b != 0).map_or(1, |i| i + 1);
    let mut frame = vec![0xFD, kept as u8, 0, 0, 7, system, component];
    frame.extend(&id.to_le_bytes()[..3]);
    frame.extend(&payload[..kept]);
    let extra = KNOWN.iter().find(|(known, ..)| *known == id).map_or(0, |(_, extra, _)| *extra);
    let sum = crc(&frame[1..], extra);
    [&received_us.to_be_bytes()[..], &frame, &sum.to_le_bytes()].concat()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_checksum_is_mavlinks() {
        // CRC-16/MCRF4XX of "123456789" is 0x6F91 (reveng catalogue); the extra byte goes last.
        assert_eq!(crc(b"12345678", b'9'), 0x6F91);
    }
}
