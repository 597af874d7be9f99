//! One kernel, compiled for the instruction sets that it may meet.
