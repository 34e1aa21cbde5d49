//! Keys of the chambers other than the muscle.

use crate::declare::{choice, table};

choice! {
    /// Direction in which pressure moves a cylinder.
    Acts {
        /// Its rod comes out: it lengthens.
        Push = "push",
        /// Its rod goes in: it shortens.
        Pull = "pull",
    }
}

table! {
    "cylinder", "a single-acting cylinder; at rest its gas volume is the dead volume", believed, physical;
    Cylinder {
        acts: choice Acts::Push, "what pressure does: lengthen it, or shorten it";
        rest_length_m: real 0.25, "m", 0.001 to 10.0, "length at rest, between what holds its ends";
        stroke_m: real 0.1, "m", 0.001 to 10.0, "way of the piston";
        area_m2: real 1.25e-3, "m2", 1.0e-7 to 10.0, "area of the piston under pressure";
        // The core's value includes the volume of the tube.
        dead_volume_m3: real 2.0e-5, "m3", 1.0e-8 to 0.05, "gas volume at rest";
        spring_n: real 50.0, "N", 0.0 to 1.0e6, "force of the return spring at rest";
        spring_stiffness_n_m: real 500.0, "N/m", 0.0 to 1.0e6, "stiffness of the return spring";
        zones: whole usize, 4, 1 to 64, "axial zones of gas and wall (full)";
    }
}

table! {
    "table", "a chamber of which volume and force have been measured, such as a bellows", believed, physical;
    Table {
        csv: csv ["length_m", "volume_m3", "force_n"], "gas volume, and force without gauge pressure, positive where it pulls the ends together; 3 to 12 rows by rising length";
        rest_length_m: optional "m", 0.001 to 10.0, "length that contraction counts from; left out: where the force is 0, or the end nearest to it";
        // The core's value includes the volume of the tube.
        dead_volume_m3: real 0.0, "m3", 0.0 to 0.05, "gas volume beside the table's";
        zones: whole usize, 4, 1 to 64, "axial zones of gas and wall (full)";
    }
}
