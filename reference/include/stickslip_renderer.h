/*
 * Interface between the testbed `stickslip` and a renderer in a shared library.
 *
 * A renderer turns positions of an instrument's tip into forces, over a body that is a network of masses, springs and
 * dampers. The library defines the functions below with C linkage. `moved` and `message` are optional; a library that
 * lacks another one is refused.
 *
 * Two threads call a renderer. The global thread calls `create`, `build`, `dispose` and `destroy`; the servo thread
 * calls `swap`, `tick` and `moved`. `build` may run while the servo thread is in `tick`, `moved` or `swap` of the same
 * renderer. `swap` precedes the first `tick`. `destroy` comes after both threads have stopped, and frees the model that
 * is in use; models that were never swapped in, and those that `swap` has returned, are disposed of before it.
 *
 * All quantities are in SI units. Vectors are x, y, z; an array of n vectors is n rows of three numbers. Arrays are
 * valid for the duration of a call, those of `stickslip_body` for the life of the renderer. The library may not write
 * to arrays that it receives as `const`.
 *
 * A tick should allocate no memory, take no lock and do no I/O: it runs in a loop at 1 kHz.
 */
#ifndef STICKSLIP_RENDERER_H
#define STICKSLIP_RENDERER_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Version of this interface, which `stickslip_renderer_abi` returns. */
#define STICKSLIP_RENDERER_ABI 1

/* Laws of contact. */
#define STICKSLIP_LAW_SLIDING 0
#define STICKSLIP_LAW_STICKING 1
#define STICKSLIP_LAW_STICK_SLIP 2

/* Contact surfaces: flat triangles, interpolated (Phong) normals, a smooth subdivision surface. */
#define STICKSLIP_SURFACE_FACETED 0
#define STICKSLIP_SURFACE_SHADED 1
#define STICKSLIP_SURFACE_SUBDIVISION 2

/* Modes of a contact. */
#define STICKSLIP_MODE_FREE 0
#define STICKSLIP_MODE_STICK 1
#define STICKSLIP_MODE_SLIDE 2
#define STICKSLIP_MODE_SLIP 3

/* The body, constant within a run. */
typedef struct stickslip_body {
  uint64_t size;                  /* size of this struct, bytes */
  uint64_t nodes;                 /* number of nodes */
  const double *rest;             /* rest positions, m: nodes x 3 */
  const double *mass;             /* lumped masses, kg: nodes */
  const uint8_t *fixed;           /* whether a node never moves, 0 or 1: nodes */
  uint64_t springs;               /* number of springs, each with a damper in parallel */
  const uint32_t *spring_nodes;   /* their two nodes: springs x 2 */
  const double *stiffness;        /* N/m: springs */
  const double *damping;          /* N s/m: springs */
  const double *rest_length;      /* m: springs */
  uint64_t triangles;             /* number of triangles of the surface */
  const uint32_t *triangle_nodes; /* their nodes, counterclockwise seen from outside: triangles x 3 */
  double gravity[3];              /* m/s^2 */
  double drag;                    /* external damping of every node's velocity, N s/m */
} stickslip_body;

/* What a scene asks of its renderer, constant within a run. */
typedef struct stickslip_setup {
  uint64_t size;           /* size of this struct, bytes */
  double tick_s;           /* time between two calls of tick, s */
  double cycle_s;          /* time between two calls of build, s */
  int32_t law;             /* STICKSLIP_LAW_... */
  int32_t surface;         /* STICKSLIP_SURFACE_... */
  double friction_static;  /* coefficient of static friction */
  double friction_kinetic; /* coefficient of kinetic friction */
  double adhesion;         /* largest pulling force of a contact, N; may be infinite */
  double radius;           /* radius of the disc over which a contact is spread, m; 0: a point */
  const char *options;     /* text for the renderer alone, UTF-8 with a terminating 0; never NULL */
} stickslip_setup;

/* State of the network at a hand-over. */
typedef struct stickslip_state {
  uint64_t size;     /* size of this struct, bytes */
  uint64_t tick;     /* number of the first tick after this state, from 0 */
  const double *x;   /* positions, m: nodes x 3 */
  const double *v;   /* velocities, m/s: nodes x 3 */
  const double *tip; /* position of the tip, m: 3 */
  int32_t mode;      /* mode of the renderer's last tick; free before the first */
  uint32_t triangle; /* contact triangle of the renderer's last tick, if it was not free */
  double weights[3]; /* barycentric weights of the contact point in that triangle */
  double normal[3];  /* contact normal of that tick, outward, of unit length */
} stickslip_state;

/* Result of a tick. */
typedef struct stickslip_output {
  uint64_t size;     /* size of this struct, bytes */
  double force[3];   /* force on the instrument, N */
  int32_t mode;      /* STICKSLIP_MODE_... */
  uint32_t triangle; /* triangle in which the contact point lies; ignored when free */
  double weights[3]; /* its barycentric weights */
  double normal[3];  /* contact normal, outward, of unit length */
} stickslip_output;

/* Returns STICKSLIP_RENDERER_ABI. */
uint32_t stickslip_renderer_abi(void);

/* Creates a renderer for a body. NULL refuses it. */
void *stickslip_renderer_create(const stickslip_body *body, const stickslip_setup *setup);

/* Builds a model from the network's state at a hand-over. NULL ends the run. */
void *stickslip_renderer_build(void *renderer, const stickslip_state *state);

/* Puts a model to use. Returns the model in use before; NULL the first time. */
void *stickslip_renderer_swap(void *renderer, void *model);

/* Renders one tick, in which the tip moves from `before` to `tip`, m. Returns 0, or a fault of the renderer's own
 * number, which ends the run. */
int32_t stickslip_renderer_tick(void *renderer, const double before[3], const double tip[3], stickslip_output *output);

/* Optional. Copies the nodes that the last tick has moved, with their positions and velocities, and returns their
 * number; above `capacity` it writes nothing, and the run ends. It is called after every tick; the set of nodes may
 * change only in `swap`. Without it the network is pushed by the opposite of the force at the contact point. */
uint64_t stickslip_renderer_moved(void *renderer, uint64_t capacity, uint32_t *nodes, double *x, double *v);

/* Frees a model that is not in use. */
void stickslip_renderer_dispose(void *model);

/* Frees a renderer, with the model in use. */
void stickslip_renderer_destroy(void *renderer);

/* Optional. Copies what went wrong last, UTF-8 without a terminating 0, at most `capacity` bytes, and returns the
 * length of the whole text. `renderer` is NULL after a refused `create`. */
uint64_t stickslip_renderer_message(void *renderer, char *buffer, uint64_t capacity);

#ifdef __cplusplus
}
#endif

#endif
