//! Any file: metadata that is fit for use or a refusal, in bounded time and memory, without a panic.
#![no_main]

use boresight::formats::metadata::{flight_log, read};
use libfuzzer_sys::fuzz_target;
use std::io::Cursor;

fuzz_target!(|bytes: &[u8]| {
    let Ok(photo) = read(&mut Cursor::new(bytes)) else { return };
    assert_eq!(photo.exposure.position.is_none(), photo.no_position.is_some());
    let log = flight_log(vec![("photo.jpg".to_owned(), photo)]);
    assert_eq!(log.exposures.len() + log.bad.len(), 1);
});
