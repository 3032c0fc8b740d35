//! tests
use stickslip::verify::elasticity::{Filling, Quantity, measure};

#[test]
fn show() {
    for filling in Filling::ALL {
        for &identification in filling.identifications() {
            for cells in [4, 8, 12, 16, 20] {
                if cells > 12 && filling.identifications().len() > 1 {
                    continue;
                }
                let t = std::time::Instant::now();
                let row = measure(Quantity::Indentation, filling, identification, cells);
                match row {
                    Ok(row) => println!(
                        "{:?} {} {:?} {} {:.3e} {:+.3e} {:?}",
                        row.quantity,
                        row.filling,
                        row.identification,
                        row.cells,
                        row.measured,
                        row.relative_error,
                        t.elapsed()
                    ),
                    Err(e) => println!("{filling:?} {e}"),
                }
            }
        }
    }
}
