//! Tests through the library's public face and through the binary; one crate, so that it links once.

mod accuracy;
mod calibrate;
mod cli;
mod doctor;
mod init;
mod logs;
mod mosaic;
mod simulated;
mod surveys;
mod tidy;
mod truth;
