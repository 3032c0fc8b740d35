/*
 * Interface between the testbed `stickslip` and a renderer in a shared library.
 *
 * A renderer turns positions of an instrument's tip into forces, over a body that is a network of masses, springs and
 * dampers. The library defines the functions below with C linkage. `moved` and `message` are optional; a library that
 * lacks another one is refused.
 *
 * Two threads call a renderer. The global thread calls `create`, `build`, `dispose` and `destroy`; the servo thread
 * calls `swap`, `tick` and `moved`; either calls `message`. `build` may run while the servo thread is in `tick`,
 * `moved` or `swap` of the same renderer. `swap` precedes the first `tick`. `destroy` comes after both threads have
 * stopped, and frees the model that is in use; models that were never swapped in, and those that `swap` has returned,
 * are disposed of before it.
 *
 * All quantities are in SI units. Vectors are x, y, z; an array of n vectors is n rows of three numbers. Arrays are
 * valid for the duration of a call, those of `stickslip_body` for the life of the renderer. The library may not write
 * to arrays that it receives as `const`. The caller sets the `size` of every struct.
 *
 * A renderer should refuse, in `create`, a law, surface or radius that it cannot render. A tick should allocate no
 * memory, take no lock and do no I/O: it runs in a loop at 1 kHz.
 */

#ifndef STICKSLIP_RENDERER_H
#define STICKSLIP_RENDERER_H

#include <stdint.h>

// Version of this interface, which `stickslip_renderer_abi` returns.
#define STICKSLIP_RENDERER_ABI 1

// Law of contact without friction.
#define STICKSLIP_LAW_SLIDING 0

// Law of contact that holds the surface point it touched.
#define STICKSLIP_LAW_STICKING 1

// Law of contact with Coulomb friction.
#define STICKSLIP_LAW_STICK_SLIP 2

// Surface of flat triangles.
#define STICKSLIP_SURFACE_FACETED 0

// Surface of flat triangles with interpolated (Phong) normals.
#define STICKSLIP_SURFACE_SHADED 1

// Smooth subdivision surface.
#define STICKSLIP_SURFACE_SUBDIVISION 2

// The tip is free.
#define STICKSLIP_MODE_FREE 0

// The contact sticks.
#define STICKSLIP_MODE_STICK 1

// The contact slides without friction.
#define STICKSLIP_MODE_SLIDE 2

// The contact slips at the Coulomb bound.
#define STICKSLIP_MODE_SLIP 3

// The body, constant within a run.
typedef struct stickslip_body {
  // Size of this struct, bytes.
  uint64_t size;
  // Number of nodes.
  uint64_t nodes;
  // Rest positions, m: nodes × 3.
  const double *rest;
  // Lumped masses, kg: nodes.
  const double *mass;
  // Whether a node never moves, 0 or 1: nodes.
  const uint8_t *fixed;
  // Number of springs, each with a damper in parallel.
  uint64_t springs;
  // Their two nodes: springs × 2.
  const uint32_t *spring_nodes;
  // Stiffness, N/m: springs.
  const double *stiffness;
  // Damping, N·s/m: springs.
  const double *damping;
  // Rest length, m: springs.
  const double *rest_length;
  // Number of triangles of the surface.
  uint64_t triangles;
  // Their nodes, counterclockwise seen from outside: triangles × 3.
  const uint32_t *triangle_nodes;
  // Gravity, m/s².
  double gravity[3];
  // Damping of every node's velocity, N·s/m.
  double drag;
} stickslip_body;

// What a scene asks of its renderer, constant within a run.
typedef struct stickslip_setup {
  // Size of this struct, bytes.
  uint64_t size;
  // Time between two calls of `tick`, s.
  double tick_s;
  // Time between two calls of `build`, s.
  double cycle_s;
  // Law of contact, `STICKSLIP_LAW_…`.
  int32_t law;
  // Contact surface, `STICKSLIP_SURFACE_…`.
  int32_t surface;
  // Coefficient of static friction; 0 without friction.
  double friction_static;
  // Coefficient of kinetic friction; 0 without friction.
  double friction_kinetic;
  // Largest pulling force of a contact, N; may be infinite.
  double adhesion;
  // Radius of the disc over which a contact is spread, m; 0 for a point.
  double radius;
  // Text for the renderer alone, UTF-8 with a terminating 0; never NULL.
  const char *options;
} stickslip_setup;

// State of the network at a hand-over.
typedef struct stickslip_state {
  // Size of this struct, bytes.
  uint64_t size;
  // Number of the first tick after this state, from 0.
  uint64_t tick;
  // Positions, m: nodes × 3.
  const double *x;
  // Velocities, m/s: nodes × 3.
  const double *v;
  // Position of the tip, m: 3.
  const double *tip;
  // Mode of the renderer's last tick, `STICKSLIP_MODE_…`; free before the first.
  int32_t mode;
  // Contact triangle of that tick; 0 when free.
  uint32_t triangle;
  // Barycentric weights of the contact point in that triangle; 0 when free.
  double weights[3];
  // Contact normal of that tick, outward, of unit length; 0 when free.
  double normal[3];
} stickslip_state;

// Result of a tick.
typedef struct stickslip_output {
  // Size of this struct, bytes.
  uint64_t size;
  // Force on the instrument, N.
  double force[3];
  // Mode of the contact, `STICKSLIP_MODE_…`.
  int32_t mode;
  // Triangle in which the contact point lies; ignored when free.
  uint32_t triangle;
  // Its barycentric weights.
  double weights[3];
  // Contact normal, outward, of unit length.
  double normal[3];
} stickslip_output;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Returns `STICKSLIP_RENDERER_ABI`.
extern uint32_t stickslip_renderer_abi(void);

// Creates a renderer for a body. NULL refuses it.
extern void *stickslip_renderer_create(const struct stickslip_body *body,
                                       const struct stickslip_setup *setup);

// Builds a model from the network's state at a hand-over. NULL ends the run.
extern void *stickslip_renderer_build(void *renderer, const struct stickslip_state *state);

// Puts a model to use. Returns the model in use before; NULL the first time.
extern void *stickslip_renderer_swap(void *renderer, void *model);

// Renders one tick, in which the tip moves from `before` to `tip`, m. Returns 0, or a fault of the renderer's own
// number, which ends the run.
extern int32_t stickslip_renderer_tick(void *renderer,
                                       const double before[3],
                                       const double tip[3],
                                       struct stickslip_output *output);

// Optional. Copies the nodes that the last tick has moved, with their positions and velocities, and returns their
// number; above `capacity` it writes nothing, and the run ends. It is called after every tick; the set of nodes may
// change only in `swap`. Without it the network is pushed by the opposite of the force at the contact point.
extern uint64_t stickslip_renderer_moved(void *renderer,
                                         uint64_t capacity,
                                         uint32_t *nodes,
                                         double *x,
                                         double *v);

// Frees a model that is not in use.
extern void stickslip_renderer_dispose(void *model);

// Frees a renderer, with the model in use.
extern void stickslip_renderer_destroy(void *renderer);

// Optional. Copies what went wrong last, UTF-8 without a terminating 0, at most `capacity` bytes, and returns the
// length of the whole text. `renderer` is NULL after a refused `create`.
extern uint64_t stickslip_renderer_message(void *renderer,
                                           char *buffer,
                                           uint64_t capacity);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* STICKSLIP_RENDERER_H */
