//! T and S from the two surfaces' F.
