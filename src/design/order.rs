//! The order in which postures are visited.

/// Most rounds of the two-opt exchange.
const ROUNDS: usize = 100;

/// An order of the postures with short moves, beginning near home: nearest neighbour, then reversals of stretches while
/// they shorten the way (two-opt; the way from home to the first posture counts, the way back does not).
///
/// The length of a move is that of its longest actuator move, each in units of the actuator's range.
pub fn short_way(postures: &[Vec<f64>], ranges: &[(f64, f64)]) -> Vec<usize> {
    let home = vec![0.0; ranges.len()];
    let at = |i: usize| if i == 0 { &home } else { &postures[i - 1] };
    let distance = |i: usize, j: usize| -> f64 {
        let pairs = at(i).iter().zip(at(j)).zip(ranges);
        let shares = pairs.map(|((a, b), (low, high))| (a - b).abs() / (high - low).max(f64::MIN_POSITIVE));
        shares.fold(0.0, f64::max)
    };
    let mut left: Vec<usize> = (1..=postures.len()).collect();
    let mut way = vec![0];
    let mut here = 0;
    while !left.is_empty() {
        let mut nearest = 0;
        for k in 1..left.len() {
            if distance(here, left[k]) < distance(here, left[nearest]) {
                nearest = k;
            }
        }
        here = left.remove(nearest);
        way.push(here);
    }
    for _ in 0..ROUNDS {
        let mut shortened = false;
        for i in 1..way.len() {
            for j in i + 1..way.len() {
                let behind = way.get(j + 1).copied();
                let end = |last: usize| behind.map_or(0.0, |behind| distance(last, behind));
                let before = distance(way[i - 1], way[i]) + end(way[j]);
                let after = distance(way[i - 1], way[j]) + end(way[i]);
                if after < before * (1.0 - 1e-12) {
                    way[i..=j].reverse();
                    shortened = true;
                }
            }
        }
        if !shortened {
            break;
        }
    }
    way.into_iter().skip(1).map(|i| i - 1).collect()
}
