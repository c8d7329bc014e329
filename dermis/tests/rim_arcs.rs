//! Arcs on the rim of a disk against a boundary integral.

mod disk_arcs;
mod reference;

use dermis::design::SkinDesign;
use dermis::forward::ForwardModel;
use dermis::mesh::Mesh;
use disk_arcs::DiskArcs;
use reference::relative_difference;
use std::f64::consts::PI;

/// `K(k)` by the arithmetic-geometric mean (DLMF 19.8.5), from the complementary modulus.
fn elliptic_k(complementary_modulus: f64) -> f64 {
    let (mut a, mut b) = (1.0, complementary_modulus);
    for _ in 0..40 {
        (a, b) = (0.5 * (a + b), f64::sqrt(a * b));
    }
    PI / (2.0 * a)
}

/// Two perfect arcs. The disk is mapped to the half plane with the electrodes from `-1/k` to `-1` and from `1` to
/// `1/k`, and that to a rectangle: the resistance is `2 K(k) / K'(k)`, with `k` from the cross ratio of the four ends.
#[test]
fn two_perfect_arcs_have_the_resistance_of_a_rectangle() {
    for half_angle in [0.02, 0.3, PI / 4.0, 1.2] {
        let arcs = DiskArcs { count: 2, half_angle, contact_impedance: 0.0, panels: 24 };
        let impedances = arcs.transfer_impedances();
        let resistance = DiskArcs::voltage(&impedances, [0, 1], [0, 1]);
        // |x2 - x1| |x4 - x3| / (|x3 - x1| |x4 - x2|) = ((1 - k) / (1 + k))^2.
        let chord = |angle: f64| (0.5 * angle).sin();
        let ratio = chord(2.0 * half_angle) / chord(PI);
        let k = (1.0 - ratio) / (1.0 + ratio);
        let exact = 2.0 * elliptic_k((1.0 - k * k).sqrt()) / elliptic_k(k);
        println!("half angle {half_angle}: {resistance} and {exact}, {:.1e}", resistance / exact - 1.0);
        assert!((resistance / exact - 1.0).abs() < 1e-6);
    }
}

#[test]
fn more_panels() {
    for z in [0.0, 1e-6, 1e-4, 1e-2, 1.0] {
        let values = [12, 18, 24, 30].map(|panels| {
            let start = std::time::Instant::now();
            let v = DiskArcs { count: 32, half_angle: 0.025 / 0.46, contact_impedance: z, panels }.transfer_impedances();
            println!("{:?}", start.elapsed());
            v
        });
        for v in &values {
            println!("{z}: {:e} {:e}", DiskArcs::voltage(v, [0, 1], [0, 1]), relative_difference(v, &values[3]));
        }
    }
}


fn tank(contact: f64, mesh: &str) -> SkinDesign {
    let text = format!("name = \"tank\"\n[body.disk]\ndiameter_m = 0.46\n[sheet]\nsheet_resistance_ohm = 1.0\n\
      touch = \"conductance_rises\"\n[electrodes]\nshape.arc.length_m = 0.025\ncontact_impedance_ohm_m = {contact:e}\n\
      layout.rim.count = 32\n[protocol]\npattern = \"adjacent\"\n[image.grid]\nrows = 32\ncolumns = 32\n{mesh}");
    SkinDesign::parse(&text, "tank.toml").unwrap()
}

#[test]
fn errors() {
    for z in [1e-8] {
        let exact = DiskArcs { count: 32, half_angle: 0.025 / 0.46, contact_impedance: z / 0.23, panels: 20 }.transfer_impedances();
        for mesh in ["", "[mesh]\nelectrode_edge_m=0.001", "[mesh]\nelectrode_edge_m=0.0005",
"[mesh]\ngrowth=0.2"] {
            let design = tank(z, mesh);
            let start = std::time::Instant::now();
            let grid = Mesh::generate(&design).unwrap();
            let meshing = start.elapsed();
            let start = std::time::Instant::now();
            let model = ForwardModel::new(&design, &grid).unwrap();
            let setup = start.elapsed();
            let mut solver = model.solver();
            let mut times = vec![];
            let mut frame = vec![0.0; design.protocol.channel_count()];
            for _ in 0..5 {
                let start = std::time::Instant::now();
                solver.solve_into(model.rest_conductivity(), &mut frame).unwrap();
                times.push(start.elapsed());
            }
            let error = |shared: &dyn Fn(usize) -> bool| {
                let mut pairs = [vec![], vec![]];
                for (c, v) in design.protocol.channels().iter().zip(&frame) {
                    let count = c.measure.iter().filter(|one| c.drive.contains(one)).count();
                    if shared(count) {
                        pairs[0].push(*v);
                        pairs[1].push(DiskArcs::voltage(&exact, c.drive, c.measure));
                    }
                }
                let worst = pairs[0].iter().zip(&pairs[1]).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
                let largest = pairs[1].iter().map(|v| v.abs()).fold(0.0, f64::max);
                let worst2 = pairs[0].iter().zip(&pairs[1]).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) / largest;
                format!("{:.3} % (worst {:.3} %, of largest {:.3} %)", 100.0 * relative_difference(&pairs[0], &pairs[1]), 100.0 * worst, 100.0 * worst2)
            };
            println!("z {z:e} {mesh:?}: {} nodes, mesh {meshing:.1?} setup {setup:.1?} solve {:.2?}: driven {}, rest {}", grid.node_count(), times.iter().min().unwrap(), error(&|k| k == 1), error(&|k| k == 0));
        }
    }
}
