use super::*;
use crate::bound::Bounds;

#[test]
#[ignore = "scratch"]
fn scratch() {
    let begun = std::time::Instant::now();
    let at = |what: &str| eprintln!("{:.1} s {what}", begun.elapsed().as_secs_f64());
    let text = SkinDesign::shipped_text("cylinder30").unwrap();
    let twin = TwinOptions::shipped("lab").unwrap();
    let moves = std::env::var("MOVES").map_or(50, |value| value.parse().unwrap());
    let same_noise = std::env::var("SAME").is_ok();
    let options = OptimiseOptions { moves, same_noise, ..OptimiseOptions::default() };
    let optimiser = Optimiser::new(text, "cylinder30", &twin, &options).unwrap();
    at("prepared");
    for name in ["better0", "given"] {
        let Ok(saved) = std::fs::read_to_string(format!("/tmp/exact-{name}.txt")) else { continue };
        let design = SkinDesign::parse(&std::fs::read_to_string(format!("/tmp/{name}.toml")).unwrap(), name).unwrap();
        let electrodes: Vec<Point3> = design.electrodes.iter().map(|e| e.centre_m).collect();
        let model = optimiser.model_bounds(&electrodes).unwrap();
        let csv: Vec<String> = std::fs::read_to_string(format!("/tmp/opt/fine-{name}.csv")).unwrap().lines().skip(1).map(String::from).collect();
        let mut out = String::new();
        let (mut sum, mut square, mut worst) = (0.0, 0.0, [0.0f64; 2]);
        for (line, (p, m)) in saved.lines().zip(&model) {
            let _ = line;
            let near = |l: &&String| { let v: Vec<f64> = l.split(',').take(3).map(|v| v.parse().unwrap()).collect(); (0..3).all(|i| (v[i] - p[i]).abs() < 1e-6) };
            let e: f64 = csv.iter().find(near).unwrap().split(',').nth(3).unwrap().parse().unwrap();
            out += &format!("{} {} {} {m} {e}\n", p[0], p[1], p[2]);
            let r = (m / e).ln();
            sum += r; square += r * r;
            worst = [worst[0].max(*m), worst[1].max(e)];
        }
        let n = model.len() as f64;
        eprintln!("{name}: log ratio mean {:.3} rms {:.3}; worst model {:.3} exact {:.3}", sum / n, (square / n).sqrt(), 1e3 * worst[0], 1e3 * worst[1]);
        std::fs::write(format!("/tmp/places-model-{name}.txt"), out).unwrap();
    }
    at("compared");
    if std::env::var("STARTS").is_err() { return; }
    
    let given = SkinDesign::shipped("cylinder30").unwrap();
    let old: Vec<Point3> = given.electrodes.iter().map(|e| e.centre_m).collect();
    let exact = |design: &SkinDesign, places: &[(Point3, f64)]| {
        let bounds = Bounds::new(design, &twin, &options.bound).unwrap();
        let exact: Vec<f64> = places
            .iter()
            .map(|(place, _)| bounds.position(*place, [place[0] / 0.05, place[1] / 0.05, 0.0]).unwrap().unwrap().sd_m)
            .collect();
        let text: String = places.iter().zip(&exact).map(|((p, m), e)| format!("{} {} {} {m} {e}\n", p[0], p[1], p[2])).collect();
        std::fs::write(format!("/tmp/places-{}.txt", design.name), text).unwrap();
        let n = exact.len() as f64;
        let lx: Vec<f64> = exact.iter().map(|v| v.ln()).collect();
        let ly: Vec<f64> = places.iter().map(|v| v.1.ln()).collect();
        let (mx, my) = (lx.iter().sum::<f64>() / n, ly.iter().sum::<f64>() / n);
        let cov = lx.iter().zip(&ly).map(|(x, y)| (x - mx) * (y - my)).sum::<f64>();
        let (vx, vy) = (lx.iter().map(|x| (x - mx).powi(2)).sum::<f64>(), ly.iter().map(|y| (y - my).powi(2)).sum::<f64>());
        let mean = exact.iter().sum::<f64>() / n;
        let max = exact.iter().cloned().fold(0.0, f64::max);
        let smean = places.iter().map(|p| p.1).sum::<f64>() / n;
        let smax = places.iter().map(|p| p.1).fold(0.0, f64::max);
        eprintln!(
            "exact mean {:.3} worst {:.3} mm; model mean {:.3} worst {:.3}; correlation {:.3} ratio {:.3}",
            1e3 * mean, 1e3 * max, 1e3 * smean, 1e3 * smax, cov / (vx * vy).sqrt(), (my - mx).exp()
        );
    };
    let model = optimiser.model_bounds(&old).unwrap();
    at("model of the old");
    exact(&given, &model);
    at("exact of the old");
    for index in 0..std::env::var("STARTS").map_or(0, |v| v.parse().unwrap()) {
        let start = optimiser.start(index).unwrap();
        at(&format!("start {index}: {:.4} mm", 1e3 * start.objective_m));
        let text = design_text(text, "cylinder30", "better", &start.electrodes_m, None).unwrap();
        std::fs::write(format!("/tmp/better{index}.toml"), &text).unwrap();
        let design = SkinDesign::parse(&text, "better").unwrap();
        exact(&design, &optimiser.model_bounds(&start.electrodes_m).unwrap());
        at("exact");
    }
}
