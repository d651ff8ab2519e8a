//! Many rows: sorted into groups that share their meshes, and the groups among the threads.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::Mutex;

use super::dispatch::{dispatch, Work};
use super::evaluate::{evaluate, Place, VALUES};
use super::march::{march, Workspace};
use super::obstacle::Contracts;
use super::plan::Plan;
use super::vector::{Vector, LANES};

/// One put per row.
#[derive(Clone, Copy)]
pub struct Rows<'a> {
    /// r T > 0.
    pub rate: &'a [f64],
    /// q T.
    pub dividend: &'a [f64],
    /// sigma sqrt(T) > 0.
    pub spread: &'a [f64],
    /// Labels that are free, at least 6.
    pub nodes: &'a [i64],
    /// dx never exceeds width / 2^halvings.
    pub halvings: &'a [i64],
}

/// The meshes: M and the widest dx.
#[derive(Clone, Copy)]
pub struct Mesh {
    /// Time steps, at least 2.
    pub steps: usize,
    /// dx of the last steps where halvings is 0.
    pub width: f64,
}

/// What `premium_values` returns, row by row.
pub struct Values {
    /// Seven per row.
    pub values: Vec<f64>,
    /// ln(S*/K).
    pub boundary: Vec<f64>,
    /// Whether the boundary stayed in its frame.
    pub settled: Vec<bool>,
}

/// What `premium_march` returns, row by row.
pub struct Profiles {
    /// `rows * components * labels`.
    pub profiles: Vec<f64>,
    /// The most labels of any row.
    pub labels: usize,
    /// xi of label 0.
    pub frame: Vec<f64>,
    /// ln(S*/K).
    pub boundary: Vec<f64>,
    /// Whether the boundary stayed in its frame.
    pub settled: Vec<bool>,
}

/// Profiles to read from, one per row of `rows`.
#[derive(Clone, Copy)]
pub struct Library<'a> {
    /// The puts.
    pub rows: Rows<'a>,
    /// dx where halvings is 0.
    pub width: f64,
    /// `rows * components * labels`.
    pub profiles: &'a [f64],
    /// 1, or 4 with the tangents.
    pub components: usize,
    /// Per profile.
    pub labels: usize,
    /// xi of label 0.
    pub frame: &'a [f64],
    /// ln(S*/K).
    pub boundary: &'a [f64],
}

/// Return V/K and its derivatives at x = ln(S/K), row by row.
#[must_use]
pub fn premium_values(mesh: Mesh, x: &[f64], rows: Rows, tangents: bool, threads: usize) -> Values {
    let count = x.len();
    let mut out = Values {
        values: vec![0.0; count * VALUES],
        boundary: vec![0.0; count],
        settled: vec![false; count],
    };
    let store = |group: &Group, found: Found<[[f64; LANES]; VALUES]>| {
        for (l, &row) in group.rows.iter().enumerate() {
            for (j, column) in found.read.iter().enumerate() {
                out.values[row * VALUES + j] = column[l];
            }
            out.boundary[row] = found.boundary[l];
            out.settled[row] = found.settled[l];
        }
    };
    let reader = AtSpots { mesh, x };
    if tangents {
        for_each_group::<4, _>(mesh, rows, threads, &reader, store);
    } else {
        for_each_group::<1, _>(mesh, rows, threads, &reader, store);
    }
    out
}

/// Return the premium (and its derivatives) at the labels, row by row.
#[must_use]
pub fn premium_march(mesh: Mesh, rows: Rows, tangents: bool, threads: usize) -> Profiles {
    let count = rows.rate.len();
    let labels = (0..count).map(|row| rows.key(row).0 + 1).max().unwrap_or(0);
    let components = if tangents { 4 } else { 1 };
    let mut out = Profiles {
        profiles: vec![0.0; count * components * labels],
        labels,
        frame: vec![0.0; count],
        boundary: vec![0.0; count],
        settled: vec![false; count],
    };
    let store = |group: &Group, found: Found<Vec<[f64; LANES]>>| {
        for (l, &row) in group.rows.iter().enumerate() {
            for (i, label) in found.read.iter().enumerate() {
                let (i, c) = (i / components, i % components);
                out.profiles[(row * components + c) * labels + i] = label[l];
            }
            out.frame[row] = found.frame[l];
            out.boundary[row] = found.boundary[l];
            out.settled[row] = found.settled[l];
        }
    };
    if tangents {
        for_each_group::<4, _>(mesh, rows, threads, &WholeProfile, store);
    } else {
        for_each_group::<1, _>(mesh, rows, threads, &WholeProfile, store);
    }
    out
}

/// Return V/K and its derivatives at each x from the profile of its row.
#[must_use]
pub fn profile_values(library: Library, row: &[i64], x: &[f64]) -> Vec<f64> {
    if library.components == 4 {
        dispatch(Reading::<4> { library, row, x })
    } else {
        dispatch(Reading::<1> { library, row, x })
    }
}

impl Rows<'_> {
    /// What rows of one group have in common.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
    fn key(&self, row: usize) -> (usize, u32) {
        (self.nodes[row] as usize, self.halvings[row] as u32)
    }

    #[inline(always)]
    fn contracts<V: Vector>(&self, rows: &[usize; LANES]) -> Contracts<V> {
        Contracts {
            rate: gather(self.rate, rows),
            dividend: gather(self.dividend, rows),
            spread: gather(self.spread, rows),
        }
    }
}

#[inline(always)]
fn gather<V: Vector>(column: &[f64], rows: &[usize; LANES]) -> V {
    V::from_lanes(rows.map(|row| column[row]))
}

fn last_spacing(width: f64, halvings: u32) -> f64 {
    width / 2.0_f64.powi(i32::try_from(halvings).unwrap_or(i32::MAX))
}

/// Rows with the same meshes, at most one per lane.
struct Group<'a> {
    plan: &'a Plan,
    halvings: u32,
    rows: &'a [usize],
}

impl Group<'_> {
    /// The row of each lane; the last one again where lanes are left over.
    fn lanes(&self) -> [usize; LANES] {
        std::array::from_fn(|l| self.rows[l.min(self.rows.len() - 1)])
    }
}

/// A marched group.
struct Found<R> {
    read: R,
    frame: [f64; LANES],
    boundary: [f64; LANES],
    settled: [bool; LANES],
}

/// What is kept of a marched group before the next one overwrites it.
trait Reader: Sync {
    type Read;
    fn read<V: Vector, const C: usize>(
        &self,
        group: &Group,
        contracts: &Contracts<V>,
        frame: V,
        boundary: V,
        state: &[[V; C]],
    ) -> Self::Read;
}

struct AtSpots<'a> {
    mesh: Mesh,
    x: &'a [f64],
}

impl Reader for AtSpots<'_> {
    type Read = [[f64; LANES]; VALUES];

    #[inline(always)]
    fn read<V: Vector, const C: usize>(
        &self,
        group: &Group,
        contracts: &Contracts<V>,
        frame: V,
        boundary: V,
        state: &[[V; C]],
    ) -> Self::Read {
        let place = Place {
            x: gather(self.x, &group.lanes()),
            frame,
            dx: V::all(last_spacing(self.mesh.width, group.halvings)),
            nodes: [group.plan.nodes; LANES],
            boundary,
        };
        let label = |l: usize, i: usize| state[i].map(|u| u.lanes()[l]);
        evaluate(contracts, &place, label).map(V::lanes)
    }
}

struct WholeProfile;

impl Reader for WholeProfile {
    type Read = Vec<[f64; LANES]>;

    #[inline(always)]
    fn read<V: Vector, const C: usize>(
        &self,
        group: &Group,
        _: &Contracts<V>,
        _: V,
        _: V,
        state: &[[V; C]],
    ) -> Self::Read {
        state[..=group.plan.nodes]
            .iter()
            .flatten()
            .map(|u| u.lanes())
            .collect()
    }
}

/// Read spots from ready profiles.
struct Reading<'a, const C: usize> {
    library: Library<'a>,
    row: &'a [i64],
    x: &'a [f64],
}

impl<const C: usize> Work for Reading<'_, C> {
    type Result = Vec<f64>;

    #[inline(always)]
    fn run<V: Vector>(self) -> Vec<f64> {
        let Library {
            rows,
            width,
            profiles,
            labels,
            ..
        } = self.library;
        let mut out = Vec::with_capacity(self.x.len() * VALUES);
        for (row, x) in self.row.chunks(LANES).zip(self.x.chunks(LANES)) {
            let last = x.len() - 1;
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)]
            let mine: [usize; LANES] = std::array::from_fn(|l| row[l.min(last)] as usize);
            let place = Place {
                x: V::from_lanes(std::array::from_fn(|l| x[l.min(last)])),
                frame: gather(self.library.frame, &mine),
                dx: V::from_lanes(mine.map(|r| last_spacing(width, rows.key(r).1))),
                nodes: mine.map(|r| rows.key(r).0),
                boundary: gather(self.library.boundary, &mine),
            };
            let label = |l: usize, i: usize| {
                std::array::from_fn(|c| profiles[(mine[l] * C + c) * labels + i])
            };
            let values = evaluate::<V, C>(&rows.contracts(&mine), &place, label).map(V::lanes);
            for l in 0..=last {
                out.extend(values.iter().map(|column| column[l]));
            }
        }
        out
    }
}

/// March every group, read it, and `store` what was read.
fn for_each_group<const C: usize, R: Reader>(
    mesh: Mesh,
    rows: Rows,
    threads: usize,
    reader: &R,
    store: impl FnMut(&Group, Found<R::Read>) + Send,
) {
    let mut families = BTreeMap::<(usize, u32), Vec<usize>>::new();
    for row in 0..rows.rate.len() {
        families.entry(rows.key(row)).or_default().push(row);
    }
    let plan =
        |&(nodes, halvings): &(usize, u32)| Plan::new(mesh.steps, mesh.width, nodes, halvings);
    let plans: Vec<Plan> = families.keys().map(plan).collect();
    let groups: Vec<Group> = families
        .iter()
        .zip(&plans)
        .flat_map(|((&(_, halvings), members), plan)| {
            members.chunks(LANES).map(move |rows| Group {
                plan,
                halvings,
                rows,
            })
        })
        .collect();
    let (next, store) = (AtomicUsize::new(0), Mutex::new(store));
    let marching = || Marching::<C, R, _> {
        rows,
        groups: &groups,
        next: &next,
        reader,
        store: &store,
    };
    let helpers = threads.min(groups.len()).saturating_sub(1);
    std::thread::scope(|scope| {
        for _ in 0..helpers {
            scope.spawn(|| dispatch(marching()));
        }
        dispatch(marching());
    });
}

/// One thread's share: the next group that nobody has taken, until there is none.
struct Marching<'a, const C: usize, R, F> {
    rows: Rows<'a>,
    groups: &'a [Group<'a>],
    next: &'a AtomicUsize,
    reader: &'a R,
    store: &'a Mutex<F>,
}

impl<const C: usize, R: Reader, F: FnMut(&Group, Found<R::Read>)> Work for Marching<'_, C, R, F> {
    type Result = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let mut work = Workspace::<V, C>::new();
        while let Some(group) = self.groups.get(self.next.fetch_add(1, Ordering::Relaxed)) {
            let contracts = self.rows.contracts(&group.lanes());
            let marched = march(group.plan, &contracts, &mut work);
            let (frame, boundary) = (marched.frame, marched.boundary);
            let found = Found {
                read: self
                    .reader
                    .read(group, &contracts, frame, boundary, &work.state),
                frame: frame.lanes(),
                boundary: boundary.lanes(),
                settled: marched.settled,
            };
            if let Ok(mut store) = self.store.lock() {
                store(group, found);
            }
        }
    }
}
