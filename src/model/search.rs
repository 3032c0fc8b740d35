//! Breadth-first search over nodes and their neighbours.

/// Returns the nodes that are reached from some nodes in at most `rings` steps to neighbours, ring by ring from these nodes
/// on, and whether each of all `count` nodes is among them.
///
/// ```
/// use stickslip::model::search::breadth_first;
///
/// // A path 0 – 1 – 2 – 3.
/// let neighbours = |node: u32| [node.checked_sub(1), (node < 3).then_some(node + 1)].into_iter().flatten();
/// assert_eq!(breadth_first(4, [1], 1, neighbours), (vec![1, 0, 2], vec![true, true, true, false]));
/// assert_eq!(breadth_first(4, [1], u32::MAX, neighbours).0, [1, 0, 2, 3]);
/// ```
pub fn breadth_first<I: Iterator<Item = u32>>(
    count: usize,
    from: impl IntoIterator<Item = u32>,
    rings: u32,
    neighbours: impl Fn(u32) -> I,
) -> (Vec<u32>, Vec<bool>) {
    let mut nodes: Vec<u32> = from.into_iter().collect();
    let mut is_reached = vec![false; count];
    nodes.iter().for_each(|&node| is_reached[node as usize] = true);
    let mut ring = 0..nodes.len();
    for _ in 0..rings {
        if ring.is_empty() {
            break;
        }
        let next = nodes.len();
        for i in ring {
            for other in neighbours(nodes[i]) {
                if !std::mem::replace(&mut is_reached[other as usize], true) {
                    nodes.push(other);
                }
            }
        }
        ring = next..nodes.len();
    }
    (nodes, is_reached)
}
