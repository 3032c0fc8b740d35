//! Contact of the instrument's tip with the surface: finding it, following it over the surface,
//! the operators that keep it, the friction law, and the tick that puts them in order.

pub mod collision;
pub mod law;
pub mod limit;
pub mod literal;
pub mod nearest;
pub mod operators;
pub mod subdivision;
pub mod surface;
pub mod tick;
pub mod tree;
