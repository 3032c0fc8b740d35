//! Separation of the parts of a body that touch only at a node or an edge. There, springs would join parts that no face of
//! a tetrahedron joins, and the surface would have no defined inside.

use std::collections::HashMap;

use super::solid::{EDGES, FACES};
use super::surface::Groups;
use crate::Vec3;

/// Separates the parts of a body of tetrahedra: every part around a node that shares no face with the others there gets a
/// node of its own. An edge whose parts are joined around both of its ends, as where a hole through the body has closed to an
/// edge, is bisected, with a node in the middle for each part. Returns the number of new nodes.
///
/// What remains is a node around which the body is one part with two surfaces: a hole that has closed to a point.
pub fn separate(nodes: &mut Vec<Vec3>, tetrahedra: &mut Vec<[u32; 4]>) -> usize {
    let before = nodes.len();
    separate_at_nodes(nodes, tetrahedra);
    // Bisection makes no new edge at which parts touch, so every round leaves fewer of them.
    while bisect_pinched(nodes, tetrahedra) {}
    nodes.len() - before
}

/// Calls `join` with the faces that two tetrahedra share: nodes of the face, and both tetrahedra.
fn shared_faces(tetrahedra: &[[u32; 4]], mut join: impl FnMut([u32; 3], u32, u32)) {
    let mut faces: Vec<([u32; 3], u32)> = Vec::with_capacity(4 * tetrahedra.len());
    for (element, corners) in (0..).zip(tetrahedra) {
        faces.extend(FACES.map(|face| {
            let mut nodes = face.map(|corner| corners[corner]);
            nodes.sort_unstable();
            (nodes, element)
        }));
    }
    faces.sort_unstable();
    for pair in faces.windows(2).filter(|pair| pair[0].0 == pair[1].0) {
        join(pair[0].0, pair[0].1, pair[1].1);
    }
}

fn separate_at_nodes(nodes: &mut Vec<Vec3>, tetrahedra: &mut [[u32; 4]]) {
    // Items: the corners of all tetrahedra.
    let mut parts = Groups::new(4 * tetrahedra.len());
    let item = |element: u32, node: u32| {
        let corner = tetrahedra[element as usize].iter().position(|&other| other == node);
        4 * element + corner.unwrap_or(0) as u32
    };
    shared_faces(tetrahedra, |face, one, other| {
        face.iter().for_each(|&node| parts.join(item(one, node), item(other, node)));
    });
    give_nodes(nodes, tetrahedra, &mut parts);
}

/// Gives every group of corners a node of its own; the first group of a node keeps that node.
fn give_nodes<const N: usize>(nodes: &mut Vec<Vec3>, elements: &mut [[u32; N]], parts: &mut Groups) {
    let mut first_part: Vec<Option<u32>> = vec![None; nodes.len()];
    let mut copies: HashMap<u32, u32> = HashMap::new();
    for (corner, node) in (0..).zip(elements.as_flattened_mut()) {
        let part = parts.of(corner);
        if *first_part[*node as usize].get_or_insert(part) != part {
            *node = *copies.entry(part).or_insert_with(|| {
                nodes.push(nodes[*node as usize]);
                nodes.len() as u32 - 1
            });
        }
    }
}

/// Bisects pinched edges that have no tetrahedron in common. Returns whether there was one.
fn bisect_pinched(nodes: &mut Vec<Vec3>, tetrahedra: &mut Vec<[u32; 4]>) -> bool {
    // Items: the edges of all tetrahedra.
    let mut parts = Groups::new(6 * tetrahedra.len());
    let item = |element: u32, ends: [u32; 2]| {
        let corners = &tetrahedra[element as usize];
        let edge = EDGES.iter().position(|edge| edge.iter().all(|&corner| ends.contains(&corners[corner])));
        6 * element + edge.unwrap_or(0) as u32
    };
    shared_faces(tetrahedra, |[a, b, c], one, other| {
        [[a, b], [b, c], [c, a]].iter().for_each(|&ends| parts.join(item(one, ends), item(other, ends)));
    });
    // Entries: the edge's nodes ascending, its part, and the item.
    let mut edges: Vec<([u32; 2], u32, u32)> = Vec::with_capacity(6 * tetrahedra.len());
    for (element, corners) in (0..).zip(tetrahedra.iter()) {
        for (edge, [i, j]) in (0..).zip(EDGES) {
            let [i, j] = [corners[i], corners[j]];
            edges.push(([i.min(j), i.max(j)], parts.of(6 * element + edge), 6 * element + edge));
        }
    }
    edges.sort_unstable();
    let mut is_cut = vec![false; tetrahedra.len()];
    let mut found = false;
    for around in edges.chunk_by(|a, b| a.0 == b.0) {
        let is_pinched = around.iter().any(|entry| entry.1 != around[0].1);
        if !is_pinched || around.iter().any(|entry| is_cut[entry.2 as usize / 6]) {
            continue;
        }
        found = true;
        let ends = around[0].0;
        for part in around.chunk_by(|a, b| a.1 == b.1) {
            let middle = nodes.len() as u32;
            nodes.push((nodes[ends[0] as usize] + nodes[ends[1] as usize]) / 2.0);
            for &(_, _, item) in part {
                let element = item as usize / 6;
                is_cut[element] = true;
                let half = |end: u32| tetrahedra[element].map(|node| if node == end { middle } else { node });
                let halves = ends.map(half);
                tetrahedra[element] = halves[0];
                tetrahedra.push(halves[1]);
            }
        }
    }
    found
}

/// Separates the parts of a surface that touch at a node: every part around it gets a node of its own. Returns the number of new
/// nodes.
pub fn separate_surface(nodes: &mut Vec<Vec3>, triangles: &mut [[u32; 3]]) -> usize {
    let before = nodes.len();
    let mut edges: Vec<([u32; 2], u32)> = Vec::with_capacity(3 * triangles.len());
    for (triangle, &[a, b, c]) in (0..).zip(triangles.iter()) {
        edges.extend([[a, b], [b, c], [c, a]].map(|[i, j]| ([i.min(j), i.max(j)], triangle)));
    }
    edges.sort_unstable();
    // Items: the corners of all triangles.
    let mut parts = Groups::new(3 * triangles.len());
    let item = |triangle: u32, node: u32| {
        let corner = triangles[triangle as usize].iter().position(|&other| other == node);
        3 * triangle + corner.unwrap_or(0) as u32
    };
    for edge in edges.chunk_by(|a, b| a.0 == b.0) {
        // At an edge of more than two triangles, which of them belong together is undefined: all stay joined, and the edge
        // is refused.
        for pair in edge.windows(2) {
            pair[0].0.iter().for_each(|&node| parts.join(item(pair[0].1, node), item(pair[1].1, node)));
        }
    }
    give_nodes(nodes, triangles, &mut parts);
    nodes.len() - before
}
