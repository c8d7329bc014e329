//! From an image to contacts.
