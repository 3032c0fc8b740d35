//! Properties that hold for every network, contact and run. Each test prints its largest residual
//! beside its tolerance; every comparison fails on NaN.

mod accuracy;
mod built_scenes;
mod certificate;
mod check;
mod closed_loop;
mod condensation;
mod contact;
mod coupling;
mod disc;
mod documents;
mod doors;
mod elasticity;
mod extremes;
mod integrators;
mod judge;
mod limit_surface;
mod limits;
mod linearization;
#[cfg(all(feature = "realtime", target_os = "linux"))]
mod logs;
mod massless;
mod mesh_files;
mod mesh_formats;
mod mesh_mutations;
mod multirate;
mod nearest;
mod network;
mod operators;
mod orders;
mod path_stability;
mod phantom;
mod phantom_motion;
mod phantom_structure;
mod rest;
mod scene_mutations;
mod settle;
mod stability;
mod subdivision;
mod suite;
mod threads;
mod timeline;
mod velocity;
mod z_width;
