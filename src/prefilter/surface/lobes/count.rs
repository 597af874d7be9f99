//! How many lobes a level needs.
use crate::geometry::HeightField;
/// E
pub struct CountError;
/// C
pub fn choose_lobe_count(_fine: &HeightField, _cells: [usize; 2]) -> usize { 6 }
/// C
pub fn lobe_count_errors(_fine: &HeightField, _cells: [usize; 2]) -> Vec<CountError> { vec![] }
