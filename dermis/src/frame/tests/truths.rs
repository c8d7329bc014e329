//! Truths and places of touches.

use super::file;
use crate::contact::Contact;
use crate::frame::{Truth, frames_after_last_touch, read_places, read_truth};
use crate::geom::vector::distance;
use crate::geom::{PlaceLimits, Surface};

/// Limits of some metres, large enough for the truths of these tests.
fn limits(surface: Surface) -> PlaceLimits {
    PlaceLimits::of_box(surface, [[-9.0; 3], [9.0; 3]], 0.0)
}

#[test]
fn truths_are_read_for_each_kind_of_body() {
    let read = |text: &str, surface: Surface| {
        let (_folder, path) = file("t.csv", text);
        read_truth(&path, &limits(surface), 3).map_err(|error| error.to_string())
    };
    let cylinder = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
    let Truth::OnSkin(touches) = read("frame,z_m,theta_rad,force_n\n2,0.1,0.0,5\n2,0.2,1,6\n", cylinder).unwrap()
    else {
        panic!("a truth with a header is on the skin")
    };
    assert_eq!(touches.iter().map(Vec::len).collect::<Vec<_>>(), [0, 0, 2]);
    assert!(distance(touches[2][0].position_m, [0.05, 0.0, 0.1]) < 1e-15);
    assert_eq!((touches[2][1].force_n, touches[2][1].id), (6.0, 1));
    let free = read("frame,x_m,y_m,z_m\n0,1,2,3\n", Surface::Free).unwrap();
    assert!(matches!(free, Truth::OnSkin(touches) if touches[0][0].position_m == [1.0, 2.0, 3.0]));
    let robot = read("1,2,3\n4,5,6\n7,8,9\n", Surface::Plane).unwrap();
    let Truth::Elsewhere { positions_m, forces_n } = robot else { panic!("a truth without a header is elsewhere") };
    assert_eq!(positions_m, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0], [7.0, 8.0, 9.0]]);
    assert!(forces_n.iter().all(|force| force.is_nan()));
    let forced = read("1,2,3,0.5\n4,5,6,1\n7,8,9,2\n", Surface::Plane).unwrap();
    assert!(matches!(forced, Truth::Elsewhere { forces_n, .. } if forces_n == [0.5, 1.0, 2.0]));
    let beyond = read("frame,x_m,y_m\n0,0,0\n3,0,0\n", Surface::Plane).unwrap_err();
    assert!(beyond.ends_with("row 3, column 1: frame 3 does not exist: the frames are 0 to 2"), "{beyond}");
    assert!(read("frame,x_m,y_m\n0.5,0,0\n", Surface::Plane).unwrap_err().contains("frame 0.5"));
    assert!(
        read("frame,x_m,y_m\n0,0,0\n", cylinder)
            .unwrap_err()
            .contains("unknown column `x_m`; the columns are frame,z_m")
    );
    assert!(read("frame,x_m\n0,0\n", Surface::Plane).unwrap_err().contains("no column `y_m`"));
    assert!(read("1,2,3\n", Surface::Plane).unwrap_err().contains("1 press for 3 frames"));
    assert!(
        read("1,2\n1,2\n1,2\n", Surface::Plane)
            .unwrap_err()
            .contains("x, y, z and optionally a force in each row, not 2")
    );
}

#[test]
fn places_off_the_body_are_named_with_their_row_and_unit() {
    let corners = [[-0.04, -0.04, 0.0], [0.04, -0.04, 0.0], [0.04, 0.04, 0.0], [-0.04, 0.04, 0.0]];
    let triangles = [[0, 1, 2], [0, 2, 3]].map(|t| t.map(|corner: usize| corners[corner]));
    let plane = PlaceLimits::of_surface(Surface::Plane, triangles, 0.01);
    let error = |text: &str, limits: &PlaceLimits| {
        let (_folder, path) = file("t.csv", text);
        let message = read_truth(&path, limits, 3).unwrap_err().to_string();
        message.split_once("t.csv").unwrap().1.to_string()
    };
    let message = error("frame,x_m,y_m\n0,0,0.045\n1,10,0\n", &plane);
    assert!(message.starts_with(", row 3: the place [10.0, 0.0, 0.0] m lies 9.9600 m off the body"), "{message}");
    assert!(message.ends_with("places are in metres; it seems to be in millimetres"), "{message}");
    let cylinder = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
    let wall = PlaceLimits::of_box(cylinder, [[-0.05, -0.05, 0.0], [0.05, 0.05, 0.3]], 0.01);
    let message = error("frame,z_m,theta_rad\n0,0.1,-120\n", &wall);
    assert!(message.starts_with(", row 2: theta_rad is -120, more than one turn"), "{message}");
}

#[test]
fn places_are_read_with_or_without_frames() {
    let read = |text: &str, surface: Surface| {
        let (_folder, path) = file("p.csv", text);
        read_places(&path, &limits(surface)).map_err(|error| error.to_string())
    };
    let cylinder = Surface::Cylinder { radius_m: 0.05, length_m: 0.3 };
    assert_eq!(read("z_m,theta_rad\n0.1,0\n", cylinder).unwrap(), [[0.05, 0.0, 0.1]]);
    let places = read("frame,x_m,y_m,force_n\n4,1,2,3\n9,4,5,6\n", Surface::Plane);
    assert_eq!(places.unwrap(), [[1.0, 2.0, 0.0], [4.0, 5.0, 0.0]]);
    assert!(read("1,2\n3,4\n", Surface::Plane).unwrap_err().ends_with("begin with a line `x_m,y_m`, lengths in m"));
    assert!(read("x_m\n3\n", Surface::Plane).unwrap_err().contains("no column `y_m`"));
}

#[test]
fn frames_after_the_last_touch_are_counted() {
    let touch = Contact::truth([0.0; 3], [0.0, 0.0, 1.0], 1.0);
    assert_eq!(frames_after_last_touch(&[vec![touch], Vec::new(), vec![touch]]), 3..3);
    assert_eq!(frames_after_last_touch(&[vec![touch], Vec::new(), Vec::new()]), 1..3);
    assert_eq!(frames_after_last_touch(&[Vec::new()]), 0..1);
}
