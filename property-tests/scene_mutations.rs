//! Scenes with values, lines and words changed at random: each is refused with a place, or runs with finite forces to its end or to a
//! fault with a name.

use std::path::Path;

use proptest::prelude::*;
use stickslip::pipeline::{self, RunError};
use stickslip::scene::{SHIPPED, Scene};

/// Memory of a scene that is run, bytes, and springs that its ticks may evaluate: so much as a second takes.
const SMALL_BYTES: u128 = 64 << 20;
const TICKS: u64 = 30;

/// Values that scenes do not have.
const VALUES: [&str; 20] = [
    "0",
    "-1",
    "1e300",
    "-1e300",
    "1e-300",
    "nan",
    "inf",
    "-inf",
    "9223372036854775807",
    "1.5",
    "0.0",
    "\"\"",
    "[]",
    "{}",
    "true",
    "\"none\"",
    "[1.0]",
    "1e12",
    "2",
    "\"all\"",
];

#[derive(Debug, Clone)]
enum Mutation {
    /// Another value for a key.
    Value {
        line: usize,
        value: usize,
    },
    /// A key with the value of another line.
    Swap {
        line: usize,
        with: usize,
    },
    Drop {
        line: usize,
    },
    Repeat {
        line: usize,
        at: usize,
    },
    /// A number multiplied.
    Scale {
        line: usize,
        exponent: i32,
    },
    Byte {
        at: usize,
        value: u8,
    },
}

fn mutation() -> impl Strategy<Value = Mutation> {
    let line = any::<usize>;
    prop_oneof![
        4 => (line(), any::<usize>()).prop_map(|(line, value)| Mutation::Value { line, value }),
        1 => (line(), any::<usize>()).prop_map(|(line, with)| Mutation::Swap { line, with }),
        1 => line().prop_map(|line| Mutation::Drop { line }),
        1 => (line(), any::<usize>()).prop_map(|(line, at)| Mutation::Repeat { line, at }),
        4 => (line(), -12..13_i32).prop_map(|(line, exponent)| Mutation::Scale { line, exponent }),
        1 => (any::<usize>(), any::<u8>()).prop_map(|(at, value)| Mutation::Byte { at, value }),
    ]
}

fn mutated(text: &str, mutations: &[Mutation]) -> String {
    let mut lines: Vec<String> = text.lines().map(str::to_owned).collect();
    for mutation in mutations {
        let count = lines.len().max(1);
        let key = |line: &str| line.split_once('=').map(|(key, _)| key.to_owned());
        match *mutation {
            Mutation::Value { line, value } => {
                if let Some(key) = key(&lines[line % count]) {
                    lines[line % count] = format!("{key}= {}", VALUES[value % VALUES.len()]);
                }
            }
            Mutation::Swap { line, with } => {
                let other = lines[with % count].split_once('=').map(|(_, value)| value.to_owned());
                if let (Some(key), Some(value)) = (key(&lines[line % count]), other) {
                    lines[line % count] = format!("{key}={value}");
                }
            }
            Mutation::Drop { line } if lines.len() > 1 => drop(lines.remove(line % count)),
            Mutation::Drop { .. } => {}
            Mutation::Repeat { line, at } => lines.insert(at % count, lines[line % count].clone()),
            Mutation::Scale { line, exponent } => {
                let text = &lines[line % count];
                let Some((key, rest)) = text.split_once('=') else { continue };
                let number: String =
                    rest.trim_start().chars().take_while(|c| c.is_ascii_digit() || "-+.e".contains(*c)).collect();
                if let Ok(number) = number.parse::<f64>() {
                    lines[line % count] = format!("{key}= {:?}", number * 10_f64.powi(exponent));
                }
            }
            Mutation::Byte { at, value } => {
                let at = at % count;
                let mut bytes = lines[at].clone().into_bytes();
                let length = bytes.len().max(1);
                if let Some(byte) = bytes.get_mut(usize::from(value) % length) {
                    *byte = value;
                }
                lines[at] = String::from_utf8_lossy(&bytes).into_owned();
            }
        }
    }
    lines.join("\n")
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 1500, ..ProptestConfig::default() })]

    /// Nothing that a scene says makes the library panic, or command a force that is not finite.
    #[test]
    fn a_mutated_scene_is_refused_or_runs(
        scene in 0..SHIPPED.len(),
        mutations in prop::collection::vec(mutation(), 1..4),
    ) {
        let text = mutated(SHIPPED[scene].text, &mutations);
        let Ok(scene) = Scene::parse(&text, Path::new("mutated.toml")) else { return Ok(()) };
        prop_assume!(scene.memory_estimate() <= SMALL_BYTES && scene.ticks_per_cycle() <= 1000 && scene.global.substeps <= 1000);
        let ticks = scene.tick_count().min(TICKS);
        let (mut finite, mut rows) = (true, 0);
        let end = pipeline::run(&scene.with_ticks(ticks), |tick| {
            finite &= tick.force.iter().all(|f| f.is_finite()) && tick.energy.is_finite();
            rows += 1;
        });
        prop_assert!(finite, "{text}");
        match end {
            Ok(()) => prop_assert_eq!(rows, ticks),
            Err(RunError::Fault(fault)) => prop_assert_eq!(fault.tick, rows),
            Err(error) => prop_assert!(!error.to_string().is_empty() && rows == 0),
        }
    }
}
