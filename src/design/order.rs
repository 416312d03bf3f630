//! The order in which postures are visited.

/// Most rounds of the two-opt exchange.
const ROUNDS: usize = 100;

/// An order of what is measured with short moves, beginning near home: nearest neighbour, then reversals of stretches
/// while they shorten the way (two-opt; the way from home to the first posture counts, the way back does not).
///
/// Each stop has the posture where it begins and the one where it ends: two where postures are compared, the same one twice
/// elsewhere. Stated is for each stop its index, and whether it is visited from its end to its beginning.
///
/// The length of a move is that of its longest actuator move, each in units of the actuator's range.
pub fn short_way(stops: &[[&[f64]; 2]], ranges: &[(f64, f64)]) -> Vec<(usize, bool)> {
    let home = vec![0.0; ranges.len()];
    let distance = |from: &[f64], to: &[f64]| -> f64 {
        let pairs = from.iter().zip(to).zip(ranges);
        let shares = pairs.map(|((a, b), (low, high))| (a - b).abs() / (high - low).max(f64::MIN_POSITIVE));
        shares.fold(0.0, f64::max)
    };
    let first = |(stop, reversed): (usize, bool)| stops[stop][usize::from(reversed)];
    let last = |(stop, reversed): (usize, bool)| stops[stop][usize::from(!reversed)];
    let mut left: Vec<usize> = (0..stops.len()).collect();
    let mut way: Vec<(usize, bool)> = Vec::with_capacity(stops.len());
    while !left.is_empty() {
        let here = way.last().map_or(home.as_slice(), |&stop| last(stop));
        let (mut nearest, mut reversed, mut least) = (0, false, f64::INFINITY);
        for (k, &stop) in left.iter().enumerate() {
            for turned in [false, true] {
                let away = distance(here, first((stop, turned)));
                if away < least {
                    (nearest, reversed, least) = (k, turned, away);
                }
            }
        }
        way.push((left.remove(nearest), reversed));
    }
    for _ in 0..ROUNDS {
        let mut shortened = false;
        for i in 0..way.len() {
            for j in i..way.len() {
                let from = i.checked_sub(1).map_or(home.as_slice(), |before| last(way[before]));
                let behind = way.get(j + 1).map(|&stop| first(stop));
                let end = |at: &[f64]| behind.map_or(0.0, |behind| distance(at, behind));
                let before = distance(from, first(way[i])) + end(last(way[j]));
                let after = distance(from, last(way[j])) + end(first(way[i]));
                if after < before * (1.0 - 1e-12) {
                    way[i..=j].reverse();
                    way[i..=j].iter_mut().for_each(|stop| stop.1 = !stop.1);
                    shortened = true;
                }
            }
        }
        if !shortened {
            break;
        }
    }
    way
}
