//! Slaves that are no encoders.
