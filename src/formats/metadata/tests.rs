//! Golden frames of the makers, real surveys, hostile files.

#[cfg(test)]
mod build;
#[cfg(test)]
mod containers;
#[cfg(test)]
mod hostile;
#[cfg(test)]
mod makers;
#[cfg(test)]
mod surveys;
