//! Performance profiles and data profiles.

/// Share of problems solved within a budget, as steps: the share from each budget on, budgets ascending.
#[derive(Clone, Debug, PartialEq)]
pub struct Profile {
    /// `(budget, share)`.
    pub steps: Vec<(f64, f64)>,
}

impl Profile {
    /// Steps of the share of `count` problems, given the budgets that solve them; infinite ones do not.
    fn of(budgets: impl Iterator<Item = f64>, count: usize) -> Self {
        let mut solved: Vec<f64> = budgets.filter(|budget| budget.is_finite()).collect();
        solved.sort_by(f64::total_cmp);
        let mut steps: Vec<(f64, f64)> = Vec::new();
        for (index, budget) in solved.into_iter().enumerate() {
            let share = (index + 1) as f64 / count.max(1) as f64;
            match steps.last_mut() {
                Some(last) if last.0 == budget => last.1 = share,
                _ => steps.push((budget, share)),
            }
        }
        Self { steps }
    }

    /// Share solved within `budget`.
    pub fn at(&self, budget: f64) -> f64 {
        self.steps.iter().take_while(|(step, _)| *step <= budget).last().map_or(0.0, |(_, share)| *share)
    }
}

/// Performance profiles of Dolan and More (Math. Programming 91, 2002): `costs[p][s]` is what solver s spends on
/// problem p, infinite where it fails; the budget is the ratio to the least of any solver on that problem.
///
/// Problems that nobody solves count for all. With more than two solvers the order of two of them may turn when a
/// third is left out (Gould and Scott, ACM TOMS 43(2), 2016).
pub fn performance(costs: &[Vec<f64>]) -> Vec<Profile> {
    let solvers = costs.iter().map(Vec::len).max().unwrap_or(0);
    let ratio = |row: &Vec<f64>, solver: usize| {
        let least = row.iter().copied().fold(f64::INFINITY, f64::min);
        match row.get(solver) {
            // Two that spend nothing are equal.
            Some(cost) if *cost == least && cost.is_finite() => 1.0,
            Some(cost) if cost.is_finite() => cost / least,
            _ => f64::INFINITY,
        }
    };
    (0..solvers).map(|solver| Profile::of(costs.iter().map(|row| ratio(row, solver)), costs.len())).collect()
}

/// How the cost of one run fell.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Descent {
    /// Evaluations and cost, in order.
    pub falls: Vec<(f64, f64)>,
}

/// Evaluations after which each solver's cost on one problem is `f <= f_L + tau (f_0 - f_L)`, infinite where it never
/// is; `f_0` is the largest first cost and `f_L` the least cost of any solver (More and Wild, SIAM J. Optim. 20(1),
/// 2009, (2.2)).
pub fn evaluations_to(runs: &[Descent], tau: f64) -> Vec<f64> {
    let all = || runs.iter().flat_map(|run| run.falls.iter().map(|(_, cost)| *cost));
    let least = all().fold(f64::INFINITY, f64::min);
    let first = runs.iter().filter_map(|run| run.falls.first()).map(|(_, cost)| *cost);
    let target = least + tau * (first.fold(least, f64::max) - least);
    let reached = |run: &Descent| run.falls.iter().find(|(_, cost)| *cost <= target).map(|(n, _)| *n);
    runs.iter().map(|run| reached(run).unwrap_or(f64::INFINITY)).collect()
}

/// Data profiles of More and Wild: share of problems on which a solver gets there within so many evaluations, here of
/// residuals and analytic Jacobians and not of groups of n + 1. `problems[p][s]` is the run of solver s on problem p.
pub fn data(problems: &[Vec<Descent>], tau: f64) -> Vec<Profile> {
    let solvers = problems.iter().map(Vec::len).max().unwrap_or(0);
    let counts: Vec<Vec<f64>> = problems.iter().map(|runs| evaluations_to(runs, tau)).collect();
    let count = |row: &Vec<f64>, solver: usize| row.get(solver).copied().unwrap_or(f64::INFINITY);
    (0..solvers)
        .map(|solver| Profile::of(counts.iter().map(|row| count(row, solver)), counts.len()))
        .collect()
}
