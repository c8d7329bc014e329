use super::*;
use crate::electrical::{Electrical, REFERENCE_TOLERANCE, electronics};
use dermis::protocol::Protocol;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// A disk with few electrodes on a coarse mesh, whose readings depend on the contacts: driven electrodes are measured.
fn design() -> SkinDesign {
    let mut design = SkinDesign::shipped("skin16").unwrap();
    design.protocol = Protocol::adjacent(16).unwrap();
    (design.mesh.max_edge_m, design.mesh.electrode_edge_m, design.mesh.growth) = (0.008, 0.001, 0.45);
    design
}

/// Resistances of a skin over those of the design: coat, contacts, reference resistor; and the switches of each drive over
/// the usual ones, ohm.
struct Skin {
    sheet: f64,
    contacts: Vec<f64>,
    reference: f64,
    switches_ohm: f64,
}

/// Voltages of the channels of a skin, by the forward model.
fn volts(design: &SkinDesign, mesh: &Mesh, skin: &Skin) -> Vec<f64> {
    let mut built = design.clone();
    built.sheet.conductance /= skin.sheet;
    for (electrode, factor) in built.electrodes.iter_mut().zip(&skin.contacts) {
        electrode.contact_impedance *= factor;
    }
    let model = ForwardModel::new(&built, mesh).unwrap();
    let network = model.network(model.rest_conductivity()).unwrap();
    let s = &network.transfer_impedance;
    let electronics = electronics(&design.protocol);
    let frame = network.frame(&design.protocol);
    let volt = |(channel, ohm): (&Channel, &f64)| {
        let [a, b] = channel.drive;
        let between_ohm = s.at(a, a) + s.at(b, b) - s.at(a, b) - s.at(b, a);
        let series_ohm = skin.reference * electronics.reference_ohm + 2.0 * electronics.on_resistance_ohm;
        electronics.source_v * ohm / (series_ohm + skin.switches_ohm + between_ohm)
    };
    design.protocol.channels().iter().zip(&frame.0).map(volt).collect()
}

fn nominal() -> Skin {
    Skin { sheet: 1.0, contacts: vec![1.0; 16], reference: 1.0, switches_ohm: 0.0 }
}

/// The standard deviation of each voltage from central differences by every resistance.
#[test]
fn the_spread_is_that_of_finite_differences() {
    let mut design = design();
    // The derivatives hold the correction at the ends of arcs constant.
    design.mesh.correct_arc_ends = false;
    let electrical = Electrical::new(&design, &[]).unwrap();
    let options = design.fabrication_options();
    let step = 1e-4;
    let slopes = |change: &dyn Fn(&mut Skin, f64)| -> Vec<f64> {
        let at = |sign: f64| {
            let mut skin = nominal();
            change(&mut skin, sign * step);
            volts(&design, &electrical.mesh, &skin)
        };
        at(1.0).iter().zip(at(-1.0)).map(|(high, low)| (high - low) / (2.0 * step)).collect()
    };
    let mut variance = vec![0.0; design.protocol.channel_count()];
    let mut add = |slopes: Vec<f64>, sd: f64| {
        variance.iter_mut().zip(slopes).for_each(|(sum, slope)| *sum += (slope * sd).powi(2))
    };
    add(slopes(&|skin, by| skin.sheet += by), options.sheet_spread);
    for electrode in 0..16 {
        add(slopes(&|skin, by| skin.contacts[electrode] += by), options.contact_spread);
    }
    add(slopes(&|skin, by| skin.reference += by), REFERENCE_TOLERANCE / 3f64.sqrt());
    // Two switches, each by itself.
    add(slopes(&|skin, by| skin.switches_ohm += by), 2f64.sqrt() * 0.3);
    let largest = variance.iter().copied().fold(0.0, f64::max).sqrt();
    let mut worst: f64 = 0.0;
    for reading in &electrical.readings {
        let Some((_, channel)) = reading.slot.measure else { continue };
        worst = worst.max((reading.volt.sd - variance[channel].sqrt()).abs() / largest);
    }
    println!("standard deviations within {worst:.1e} of the largest, by finite differences");
    // The square of the step, and rounding over the step.
    assert!(worst < 1e-6, "{worst}");
}

/// Of skins drawn by the model, at most as many as three standard deviations leave are outside the limits.
#[test]
fn drawn_skins_are_within_the_limits() {
    let design = design();
    let electrical = Electrical::new(&design, &[]).unwrap();
    let options = design.fabrication_options();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    // Sum of twelve: a normal distribution but for its ends, which are beyond four standard deviations.
    let mut normal = |sd: f64| sd * ((0..12).map(|_| rng.random::<f64>()).sum::<f64>() - 6.0);
    const SKINS: usize = 200;
    let (mut outside, mut all) = (0, 0);
    let mut square = vec![0.0; design.protocol.channel_count()];
    for _ in 0..SKINS {
        let skin = Skin {
            sheet: 1.0 + normal(options.sheet_spread),
            contacts: (0..16).map(|_| (1.0 + normal(options.contact_spread)).max(0.01)).collect(),
            reference: 1.0 + normal(REFERENCE_TOLERANCE / 3f64.sqrt()),
            switches_ohm: normal(0.3) + normal(0.3),
        };
        let drawn = volts(&design, &electrical.mesh, &skin);
        for reading in &electrical.readings {
            let Some((_, channel)) = reading.slot.measure else { continue };
            let [low, high] = reading.volt.limits();
            all += 1;
            outside += usize::from(!(low..=high).contains(&drawn[channel]));
            square[channel] += (drawn[channel] - reading.volt.nominal).powi(2) / SKINS as f64;
        }
    }
    let rate = f64::from(outside as u32) / f64::from(all as u32);
    println!("{SKINS} drawn skins: {outside} of {all} readings outside the limits ({:.2} %)", 100.0 * rate);
    // 0.27 % of a normal distribution; more where the second order bends it.
    assert!(rate < 0.02, "{rate}");
    let of = |reading: &crate::electrical::Reading| Some(square[reading.slot.measure?.1].sqrt() / reading.volt.sd);
    let ratios: Vec<f64> = electrical.readings.iter().filter_map(of).collect();
    let mean = ratios.iter().sum::<f64>() / ratios.len() as f64;
    println!("standard deviation drawn over that of the table: {mean:.2} in the mean");
    // 5 % from the number of skins, and the second order of 20 % and 30 %.
    assert!((mean - 1.0).abs() < 0.2, "{mean}");
}
