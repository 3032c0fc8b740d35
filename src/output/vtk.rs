//! Frames of a run for ParaView: the network and the instrument as `.vtu` files, and `.pvd` files with their times.
//!
//! The format, a few tags around arrays in base 64, is written here: the only crate that writes it depends on parsers
//! that are no longer maintained.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use base64::{Engine, prelude::BASE64_STANDARD};

use super::files::{WriteError, write_file};
use crate::Vec3;
use crate::model::mesh::Mesh;
use crate::model::network::Network;
use crate::model::topology::Surface;
use crate::pipeline::TickView;

/// Cell type of a point.
const VTK_VERTEX: u8 = 1;
/// Cell type of a line.
const VTK_LINE: u8 = 3;
/// Cell type of a triangle.
const VTK_TRIANGLE: u8 = 5;
/// Cell type of a tetrahedron.
const VTK_TETRA: u8 = 10;

/// Folder of the frames, beside the `.pvd` files.
pub(super) const FRAMES: &str = "vtk";

/// Writer of a run's frames.
///
/// - `network.pvd` has the nodes with velocity, net force, mass, whether they are fixed, whether they are in the patch,
///   and their weight in the contact point. Its cells are the triangles of the surface and the springs.
/// - `instrument.pvd` has the tip with its force, the contact's normal and the contact state (0 free, 1 stick, 2 slide,
///   3 slip).
///
/// Positions of patch nodes come from the local side, those of other surface nodes from the local model, and all others
/// from the global side at the last cycle boundary. All quantities are SI.
///
/// ```
/// use stickslip::{output::vtk::VtkWriter, pipeline, scene::Scene};
///
/// // The tip meets the block after 80 ticks.
/// let scene = Scene::shipped("fig3-sliding").expect("shipped with the program").with_ticks(150);
/// let folder = tempfile::tempdir()?;
/// let mut writer = VtkWriter::new(folder.path(), 50)?;
/// pipeline::run(&scene, |tick| writer.record(tick))?;
/// assert_eq!(writer.finish()?, 3);
/// let times = std::fs::read_to_string(folder.path().join("network.pvd"))?;
/// assert_eq!(times.matches("<DataSet timestep=").count(), 3);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct VtkWriter {
    out: PathBuf,
    every_ticks: u64,
    cells: String,
    times: Vec<f64>,
    x: Vec<Vec3>,
    v: Vec<Vec3>,
    f: Vec<Vec3>,
    trouble: Option<WriteError>,
}

impl VtkWriter {
    /// Creates the folder of the frames; a frame is written every `every_ticks` ticks, or every tick if that is 0.
    ///
    /// # Errors
    /// If the folder cannot be created.
    pub fn new(out: &Path, every_ticks: u64) -> Result<Self, WriteError> {
        let frames = out.join(FRAMES);
        fs::create_dir_all(&frames).map_err(|source| WriteError { path: frames, source })?;
        Ok(Self {
            out: out.to_owned(),
            every_ticks: every_ticks.max(1),
            cells: String::new(),
            times: Vec::new(),
            x: Vec::new(),
            v: Vec::new(),
            f: Vec::new(),
            trouble: None,
        })
    }

    /// Records a tick. [`finish`](Self::finish) returns the error if a file cannot be written.
    pub fn record(&mut self, view: &TickView) {
        if self.trouble.is_some() || !view.tick.is_multiple_of(self.every_ticks) {
            return;
        }
        if let Err(error) = self.write_frame(view) {
            self.trouble = Some(error);
        }
    }

    /// Writes the `.pvd` files and returns the number of frames.
    ///
    /// # Errors
    /// If a file, of this call or of a frame, could not be written.
    pub fn finish(self) -> Result<usize, WriteError> {
        if let Some(error) = self.trouble {
            return Err(error);
        }
        for name in ["network", "instrument"] {
            let mut sets = String::new();
            for (frame, time) in self.times.iter().enumerate() {
                let _ = writeln!(sets, "<DataSet timestep=\"{time}\" file=\"{}\"/>", file_name(name, frame));
            }
            let text = document("Collection", &format!("<Collection>\n{sets}</Collection>\n"));
            write_file(&self.out.join(format!("{name}.pvd")), text.as_bytes())?;
        }
        Ok(self.times.len())
    }

    fn write_frame(&mut self, view: &TickView) -> Result<(), WriteError> {
        self.place(view);
        if self.cells.is_empty() {
            self.cells = cells(view.network, &view.local.surface().topology);
        }
        let network = view.network;
        let patch = &view.local.model().patch;
        let mut in_patch = vec![0_u8; network.node_count()];
        patch.nodes.iter().for_each(|&node| in_patch[node as usize] = 1);
        let fixed: Vec<u8> = network.fixed.iter().map(|&fixed| fixed.into()).collect();
        let data = [
            vectors("velocity", &self.v),
            vectors("force", &self.f),
            scalars("mass", &network.mass),
            bytes("fixed", &fixed),
            bytes("patch", &in_patch),
            scalars("contact_weight", &contact_weights(view)),
        ];
        let frame = self.times.len();
        let piece = piece(&self.x, &self.cells, &data.concat());
        write_file(&self.out.join(file_name("network", frame)), piece.as_bytes())?;

        let normal = view.report.touch.map_or(Vec3::zeros(), |touch| touch.normal);
        let data =
            [vectors("force", &[view.force]), vectors("normal", &[normal]), bytes("mode", &[view.report.mode as u8])];
        let tip = piece_of_cells(&[view.tip], &[0], &[1], &[VTK_VERTEX], &data.concat());
        write_file(&self.out.join(file_name("instrument", frame)), tip.as_bytes())?;
        self.times.push(view.time);
        Ok(())
    }

    /// Sets positions, velocities and net forces of all nodes.
    fn place(&mut self, view: &TickView) {
        let (model, state) = (view.local.model(), view.local.state());
        self.x.clone_from(&view.network_state.x);
        self.v.clone_from(&view.network_state.v);
        for (vertex, &node) in view.local.surface().topology.vertex_node.iter().enumerate() {
            self.x[node as usize] = model.vertex(vertex as u32, &state.x, view.local.elapsed());
        }
        for (slot, &node) in model.patch.nodes.iter().enumerate() {
            self.x[node as usize] = state.x[slot];
            self.v[node as usize] = state.v[slot];
        }
        self.f.resize(self.x.len(), Vec3::zeros());
        view.network.forces(&self.x, &self.v, &mut self.f);
    }
}

/// Returns every node's weight in the contact point; all are zero in a free tick.
fn contact_weights(view: &TickView) -> Vec<f64> {
    let mut weights = vec![0.0; view.network.node_count()];
    if let Some(touch) = view.report.touch {
        for (node, weight) in view.local.surface().node_weights(&touch.point) {
            weights[node] += weight;
        }
    }
    weights
}

/// Builds a `.vtu` file of a body at rest: the surface's triangles and the springs as cells, with the mass of each node and
/// whether it is fixed.
pub fn body(network: &Network, surface: &Surface) -> String {
    let fixed: Vec<u8> = network.fixed.iter().map(|&fixed| fixed.into()).collect();
    let data = [scalars("mass", &network.mass), bytes("fixed", &fixed)];
    piece(&network.rest, &cells(network, surface), &data.concat())
}

/// Builds a `.vtu` file of a mesh of tetrahedra.
pub fn solid(mesh: &Mesh) -> String {
    let connectivity: Vec<i64> = mesh.tetrahedra.iter().flatten().map(|&node| node.into()).collect();
    let offsets: Vec<i64> = (1..=mesh.tetrahedra.len() as i64).map(|i| 4 * i).collect();
    piece_of_cells(&mesh.nodes, &connectivity, &offsets, &vec![VTK_TETRA; mesh.tetrahedra.len()], "")
}

/// Builds the cells: the surface's triangles, then the springs.
fn cells(network: &Network, surface: &Surface) -> String {
    let Network { springs, .. } = network;
    let triangles = (0..surface.triangles.len() as u32).flat_map(|triangle| surface.triangle_nodes(triangle));
    let connectivity: Vec<i64> =
        triangles.chain(springs.iter().flat_map(|spring| spring.nodes)).map(i64::from).collect();
    let corners = 3 * surface.triangles.len() as i64;
    let ends = (1..=surface.triangles.len() as i64).map(|i| 3 * i);
    let offsets: Vec<i64> = ends.chain((1..=springs.len() as i64).map(|i| corners + 2 * i)).collect();
    let mut types = vec![VTK_TRIANGLE; surface.triangles.len()];
    types.resize(offsets.len(), VTK_LINE);
    cells_of(&connectivity, &offsets, &types)
}

fn cells_of(connectivity: &[i64], offsets: &[i64], types: &[u8]) -> String {
    let arrays = [
        array("Int64", "connectivity", 1, connectivity.iter().flat_map(|i| i.to_le_bytes())),
        array("Int64", "offsets", 1, offsets.iter().flat_map(|i| i.to_le_bytes())),
        array("UInt8", "types", 1, types.iter().copied()),
    ];
    format!("NumberOfCells=\"{}\">\n<Cells>\n{}</Cells>\n", types.len(), arrays.concat())
}

fn piece_of_cells(x: &[Vec3], connectivity: &[i64], offsets: &[i64], types: &[u8], data: &str) -> String {
    piece(x, &cells_of(connectivity, offsets, types), data)
}

/// Builds a whole `.vtu` file.
fn piece(x: &[Vec3], cells: &str, data: &str) -> String {
    let points = vectors("Points", x);
    document(
        "UnstructuredGrid",
        &format!(
            "<UnstructuredGrid>\n<Piece NumberOfPoints=\"{}\" {cells}<Points>\n{points}</Points>\n<PointData>\n\
             {data}</PointData>\n</Piece>\n</UnstructuredGrid>\n",
            x.len()
        ),
    )
}

fn document(kind: &str, body: &str) -> String {
    format!(
        "<?xml version=\"1.0\"?>\n<VTKFile type=\"{kind}\" version=\"1.0\" byte_order=\"LittleEndian\" \
         header_type=\"UInt64\">\n{body}</VTKFile>\n"
    )
}

fn file_name(name: &str, frame: usize) -> String {
    format!("{FRAMES}/{name}-{frame:06}.vtu")
}

/// Returns whether a file is named like a frame.
pub(super) fn is_frame(file: &str) -> bool {
    let number = file
        .strip_suffix(".vtu")
        .and_then(|stem| ["network-", "instrument-"].iter().find_map(|name| stem.strip_prefix(name)));
    number.is_some_and(|number| number.len() >= 6 && number.bytes().all(|byte| byte.is_ascii_digit()))
}

fn vectors(name: &str, values: &[Vec3]) -> String {
    array("Float64", name, 3, values.iter().flat_map(|v| v.iter().flat_map(|c| c.to_le_bytes()).collect::<Vec<_>>()))
}

fn scalars(name: &str, values: &[f64]) -> String {
    array("Float64", name, 1, values.iter().flat_map(|value| value.to_le_bytes()))
}

fn bytes(name: &str, values: &[u8]) -> String {
    array("UInt8", name, 1, values.iter().copied())
}

/// Builds an array in base 64: its length in bytes, then the bytes.
fn array(kind: &str, name: &str, components: usize, bytes: impl Iterator<Item = u8>) -> String {
    let mut block = vec![0; 8];
    block.extend(bytes);
    let length = (block.len() as u64 - 8).to_le_bytes();
    block[..8].copy_from_slice(&length);
    format!(
        "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfComponents=\"{components}\" format=\"binary\">{}</DataArray>\n",
        BASE64_STANDARD.encode(block)
    )
}
