use dermis::frame::read_frames;
use dermis::skin::Skin;
use dermis_calibrate::checks::*;
use std::path::PathBuf;
fn main(){
 let skin=Skin::load("skin16").unwrap();
 let folder=PathBuf::from("/work/shared/data/skins_real");
 for name in ["noPattern","parallel"]{
  let frames=read_frames(&folder.join(format!("inp_{name}.csv")),&skin.design().protocol).unwrap();
  let mut lags=vec![0;192]; lags[..24].fill(1);
  let mut re=realigned(&frames,&lags).unwrap();
  for stage in 0..3 {
  if stage==2 {re.iter_mut().for_each(|f|f.0[..24].iter_mut().for_each(|v|*v=-*v));}
  let fr=if stage==0 {&frames} else {&re};
  let t=std::time::Instant::now();
  let c=check_recording(&skin,&Recording{frames:fr,untouched:&[],positions_m:None}).unwrap();
  println!("== {name} {stage} {:.1}s cos {:.3} drift {:.4} memory {:.4}",t.elapsed().as_secs_f64(),c.figures.correlation_cosine,c.figures.drift,c.figures.memory);
  for f in &c.findings {println!("{:?} lag {} value {:.3} channels {:?} rows {:?} | {} | {}",f.kind,f.lag,f.value,f.channels,&f.rows[..f.rows.len().min(5)],f.evidence,f.fix);}
  let mut best:Vec<f64>=c.figures.lag_explained.iter().map(|e|e.iter().copied().fold(-9.0,f64::max)).collect(); 
  if stage==0 {for ch in 0..36 {println!("{ch}: {:.2?}",c.figures.lag_explained[ch]);}}
  best.sort_by(f64::total_cmp); println!("explained min {:?} med {:.3}",&best[..8],best[96]);
  }
 }
}
