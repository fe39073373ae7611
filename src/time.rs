//! Time: log clocks and exposure times as seconds on one named clock.
