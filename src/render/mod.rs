//! Figures, tables and pages: plain data in, bytes out. Nothing here knows a machine, an identifier or a file.
//!
//! The same data give the same bytes. Lines of text and axes take the colour of the text around them
//! (`currentColor`), so that one drawing serves light, dark and paper; series have fixed colours that are told
//! apart by colour-blind readers, and markers besides.

pub mod axis;
pub mod drawing;
pub mod figure;
pub mod page;
pub mod palette;
pub mod svg;
pub mod table;
pub mod text;

pub use axis::Axis;
pub use drawing::Drawing;
pub use figure::{Figure, Kind, Point, ReferenceLine, Series, Shape};
pub use page::{Page, Part, Section};
pub use palette::{Marker, Palette, Style};
pub use table::{Cell, Column, Table};
