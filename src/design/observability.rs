//! Observability indices of a set of postures (docs/theory.md (11.1)).

/// The five indices, over the directions that the postures can see.
///
/// The singular values are those of the whitened Jacobian in tolerance-scaled minimal coordinates, so that the indices
/// depend neither on units nor on the names of coordinates. The product over all directions would be 0 wherever a
/// direction has no first-order effect, which holds for most machines as drawn: the indices are therefore taken over
/// the k values above 1, the practical count. Two sets of postures can be compared where k is the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Observability {
    /// Number k of directions that the indices are taken over.
    pub directions: usize,
    /// Number m of postures.
    pub poses: usize,
    /// `(s_1 ... s_k)^(1/k) / sqrt(m)`: volume of the ellipsoid of confidence (Borm & Menq 1991).
    pub o1: f64,
    /// `s_k / s_1`: eccentricity (Driels & Pathre 1990).
    pub o2: f64,
    /// `s_k`: the worst direction (Nahvi, Hollerbach & Hayward 1994).
    pub o3: f64,
    /// `s_k^2 / s_1`: noise amplification (Nahvi & Hollerbach 1996).
    pub o4: f64,
    /// `1 / (1/s_1 + ... + 1/s_k)` (Sun & Hollerbach 2008).
    pub o5: f64,
}

impl Observability {
    /// The indices of `poses` postures with these whitened singular values, over those above 1; `None` where there are
    /// none.
    pub fn of(singular_values: &[f64], poses: usize) -> Option<Self> {
        let seen: Vec<f64> = singular_values.iter().copied().filter(|s| *s > 1.0).collect();
        let largest = seen.iter().copied().reduce(f64::max)?;
        let smallest = seen.iter().copied().reduce(f64::min)?;
        let count = seen.len() as f64;
        // Logarithms, for the product of a hundred values would overflow.
        let mean_log = seen.iter().map(|s| s.ln()).sum::<f64>() / count;
        Some(Self {
            directions: seen.len(),
            poses,
            o1: mean_log.exp() / (poses.max(1) as f64).sqrt(),
            o2: smallest / largest,
            o3: smallest,
            o4: smallest * smallest / largest,
            o5: 1.0 / seen.iter().map(|s| 1.0 / s).sum::<f64>(),
        })
    }
}
