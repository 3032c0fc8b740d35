/*
 * A renderer in C++17 with Eigen: a penalty force at the nearest surface point, with Coulomb friction by a tangential
 * spring that slips (Cundall & Strack 1979).
 *
 * Symbols: q the tip, p the surface point nearest to it, n = (p - q)/|p - q| the outward normal, depth = |p - q|, k the
 * penalty stiffness (N/m), a the anchor of friction, a point of the material.
 *   normal force      F_N n,  F_N = k depth
 *   tangential force  k t,    t = the tangential part of a - p; |k t| <= mu F_N, beyond which the anchor slips
 * The network feels the opposite force at p: this renderer has no function `moved`.
 */
#include <Eigen/Dense>
#include <Eigen/Sparse>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <exception>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "stickslip_renderer.h"

namespace {

using Eigen::Matrix3d;
using Eigen::Matrix3Xd;
using Eigen::Vector3d;

/* The interface stores vectors by rows, node after node. As Eigen stores by columns, an array of n vectors is a matrix
 * of 3 x n, without a copy. */
using ConstPoints = Eigen::Map<const Matrix3Xd>;
using ConstTriangles = Eigen::Map<const Eigen::Matrix<uint32_t, 3, Eigen::Dynamic>>;
using ConstVector = Eigen::Map<const Vector3d>;

ConstPoints points(const double *array, uint64_t nodes) { return {array, 3, static_cast<Eigen::Index>(nodes)}; }

enum Fault { FAULT_TIP = 1, FAULT_FORCE = 2, FAULT_NO_MODEL = 3 };
constexpr const char *FAULT_TEXT[] = {"", "a coordinate of the tip is not finite", "the force is not finite",
                                      "a tick was called before a model was swapped in"};

thread_local std::string refusal;

/* ---- Geometry ------------------------------------------------------------------------------------------------- */

/* A point of the surface: a triangle and barycentric weights. */
struct SurfacePoint {
  uint32_t triangle = 0;
  Vector3d weights = Vector3d::Zero();
};

/* Weights of the point of a triangle that is nearest to q (Ericson, Real-Time Collision Detection, 5.1.5). */
Vector3d nearest_weights(const Vector3d &a, const Vector3d &b, const Vector3d &c, const Vector3d &q) {
  const Vector3d ab = b - a, ac = c - a;
  const double d1 = ab.dot(q - a), d2 = ac.dot(q - a);
  if (d1 <= 0.0 && d2 <= 0.0) return {1.0, 0.0, 0.0};
  const double d3 = ab.dot(q - b), d4 = ac.dot(q - b);
  if (d3 >= 0.0 && d4 <= d3) return {0.0, 1.0, 0.0};
  const double d5 = ab.dot(q - c), d6 = ac.dot(q - c);
  if (d6 >= 0.0 && d5 <= d6) return {0.0, 0.0, 1.0};
  const double vc = d1 * d4 - d3 * d2;
  if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) return {1.0 - d1 / (d1 - d3), d1 / (d1 - d3), 0.0};
  const double vb = d5 * d2 - d1 * d6;
  if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) return {1.0 - d2 / (d2 - d6), 0.0, d2 / (d2 - d6)};
  const double va = d3 * d6 - d5 * d4;
  if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
    const double w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
    return {0.0, 1.0 - w, w};
  }
  const double sum = va + vb + vc;
  return {va / sum, vb / sum, vc / sum};
}

/* ---- Renderer ------------------------------------------------------------------------------------------------- */

/* A model is the shape of the network at a hand-over. */
struct Model {
  Matrix3Xd x;
};

struct Options {
  double stiffness = 0.0; /* N/m; 0: from the network */
};

class Renderer {
 public:
  Renderer(const stickslip_body &body, const stickslip_setup &setup, const Options &options)
      : setup_(setup),
        triangles_(body.triangle_nodes, 3, static_cast<Eigen::Index>(body.triangles)),
        stiffness_(options.stiffness > 0.0 ? options.stiffness : stiffness_of(body)),
        shown_(points(body.rest, body.nodes)),
        from_(shown_) {}

  std::unique_ptr<Model> build(const stickslip_state &state) const {
    return std::make_unique<Model>(Model{points(state.x, static_cast<uint64_t>(shown_.cols()))});
  }

  /* The shape glides from what was shown to the new model within a cycle, so that the force has no jump here. */
  std::unique_ptr<Model> swap(std::unique_ptr<Model> model) noexcept {
    if (!model_) shown_ = model->x;
    from_ = shown_;
    progress_ = 0.0;
    std::swap(model_, model);
    return model;
  }

  int tick(const Vector3d &q, stickslip_output &output) noexcept {
    if (!model_) return FAULT_NO_MODEL;
    if (!q.allFinite()) return FAULT_TIP;
    progress_ = std::min(1.0, progress_ + setup_.tick_s / setup_.cycle_s);
    shown_ = from_ + progress_ * (model_->x - from_);

    SurfacePoint contact;
    if (!find_contact(q, contact)) {
      mode_ = STICKSLIP_MODE_FREE;
      return 0;
    }
    const Vector3d p = position(contact), n = (p - q).normalized();
    const double normal_force = stiffness_ * (p - q).norm();
    Vector3d force = normal_force * n;
    int32_t mode = STICKSLIP_MODE_SLIDE;

    if (setup_.law != STICKSLIP_LAW_SLIDING) {
      if (mode_ == STICKSLIP_MODE_FREE) anchor_ = contact;
      const Vector3d apart = position(anchor_) - p;
      Vector3d t = apart - n.dot(apart) * n;
      const double tangential_force = stiffness_ * t.norm();
      const double friction = mode_ == STICKSLIP_MODE_SLIP ? setup_.friction_kinetic : setup_.friction_static;
      mode = STICKSLIP_MODE_STICK;
      if (setup_.law == STICKSLIP_LAW_STICK_SLIP && tangential_force > friction * normal_force) {
        mode = STICKSLIP_MODE_SLIP;
        t *= setup_.friction_kinetic * normal_force / tangential_force;
        anchor_ = fixed_to_material(p + t, contact.triangle);
      }
      force += stiffness_ * t;
    }
    if (!force.allFinite()) return FAULT_FORCE;

    mode_ = output.mode = mode;
    output.triangle = contact.triangle;
    Vector3d::Map(output.force) = force;
    Vector3d::Map(output.weights) = contact.weights;
    Vector3d::Map(output.normal) = n;
    return 0;
  }

  void report(const char *text) noexcept { message_.store(text); }
  const char *message() const noexcept { return message_.load(); }

 private:
  Vector3d corner(uint32_t triangle, int k) const { return shown_.col(triangles_(k, triangle)); }

  Vector3d position(const SurfacePoint &at) const {
    return at.weights[0] * corner(at.triangle, 0) + at.weights[1] * corner(at.triangle, 1) +
           at.weights[2] * corner(at.triangle, 2);
  }

  /* A point near the plane of a triangle, as weights in it, which may be negative. */
  SurfacePoint fixed_to_material(const Vector3d &point, uint32_t triangle) const {
    const Vector3d a = corner(triangle, 0), ab = corner(triangle, 1) - a, ac = corner(triangle, 2) - a;
    const Vector3d normal = ab.cross(ac);
    const double w1 = (point - a).cross(ac).dot(normal) / normal.squaredNorm();
    const double w2 = ab.cross(point - a).dot(normal) / normal.squaredNorm();
    return {triangle, {1.0 - w1 - w2, w1, w2}};
  }

  /* Finds the surface point nearest to q. Returns false where q is not inside the body. */
  bool find_contact(const Vector3d &q, SurfacePoint &contact) const {
    double least = std::numeric_limits<double>::infinity();
    for (uint32_t t = 0; t < triangles_.cols(); ++t) {
      const Vector3d a = corner(t, 0), b = corner(t, 1), c = corner(t, 2);
      const Vector3d weights = nearest_weights(a, b, c, q);
      const double square = (weights[0] * a + weights[1] * b + weights[2] * c - q).squaredNorm();
      if (square < least) least = square, contact = {t, weights};
    }
    /* A tip on the surface, to round-off, has no direction to be pushed in. */
    if (!(least > 1e-24)) return false;
    return (q - position(contact)).dot(pseudonormal(contact)) < 0.0;
  }

  /* Sum of the normals around a surface point, weighted by the angles of their triangles: its sign tells inside from
   * outside (Baerentzen & Aanaes 2005). A triangle counts where it contains every corner that carries weight. */
  Vector3d pseudonormal(const SurfacePoint &at) const {
    uint32_t carrying[3];
    int count = 0;
    for (int k = 0; k < 3; ++k)
      if (at.weights[k] > 0.0) carrying[count++] = triangles_(k, at.triangle);
    Vector3d sum = Vector3d::Zero();
    for (uint32_t t = 0; t < triangles_.cols(); ++t) {
      int shared = 0, at_corner = 0;
      for (int k = 0; k < 3; ++k)
        for (int i = 0; i < count; ++i)
          if (triangles_(k, t) == carrying[i]) ++shared, at_corner = k;
      if (shared < count) continue;
      const Vector3d one = corner(t, (at_corner + 1) % 3) - corner(t, at_corner);
      const Vector3d two = corner(t, (at_corner + 2) % 3) - corner(t, at_corner);
      const Vector3d normal = one.cross(two);
      sum += (count == 1 ? std::atan2(normal.norm(), one.dot(two)) : 1.0) * normal.normalized();
    }
    return sum;
  }

  /* Three quarters of the static stiffness of the network at rest, N/m, at the softest of a sample of surface nodes and
   * in its softest direction. The network answers a force one hand-over later, so that a penalty which is stiffer than
   * the network lets force and shape overshoot each other. */
  static double stiffness_of(const stickslip_body &body) {
    const auto rest = points(body.rest, body.nodes);
    std::vector<Eigen::Index> place(body.nodes, -1);
    Eigen::Index size = 0;
    for (uint64_t i = 0; i < body.nodes; ++i)
      if (!body.fixed[i]) place[i] = size, size += 3;

    std::vector<Eigen::Triplet<double>> entries;
    const auto add = [&](Eigen::Index row, Eigen::Index column, const Matrix3d &block) {
      if (row < 0 || column < 0) return;
      for (int a = 0; a < 3; ++a)
        for (int b = 0; b < 3; ++b) entries.emplace_back(row + a, column + b, block(a, b));
    };
    for (uint64_t s = 0; s < body.springs; ++s) {
      const uint32_t i = body.spring_nodes[2 * s], j = body.spring_nodes[2 * s + 1];
      const Vector3d u = (rest.col(j) - rest.col(i)).normalized();
      const Matrix3d block = body.stiffness[s] * u * u.transpose();
      add(place[i], place[i], block), add(place[j], place[j], block);
      add(place[i], place[j], -block), add(place[j], place[i], -block);
    }
    Eigen::SparseMatrix<double> matrix(size, size);
    matrix.setFromTriplets(entries.begin(), entries.end());
    const Eigen::SimplicialLDLT<Eigen::SparseMatrix<double>> factor(matrix);
    const char *unsupported = "the network at rest has no static stiffness; give the option stiffness";
    if (size == 0 || factor.info() != Eigen::Success ||
        !(factor.vectorD().minCoeff() > 1e-10 * factor.vectorD().maxCoeff()))
      throw std::invalid_argument(unsupported);

    std::vector<uint32_t> surface(body.triangle_nodes, body.triangle_nodes + 3 * body.triangles);
    std::sort(surface.begin(), surface.end());
    surface.erase(std::unique(surface.begin(), surface.end()), surface.end());
    surface.erase(std::remove_if(surface.begin(), surface.end(), [&](uint32_t i) { return body.fixed[i] != 0; }),
                  surface.end());
    const size_t stride = surface.size() / 50 + 1;
    double compliance = 0.0;
    for (size_t s = 0; s < surface.size(); s += stride) {
      const Eigen::Index at = place[surface[s]];
      Matrix3d response; /* displacement per force of the node */
      for (int a = 0; a < 3; ++a)
        response.col(a) = factor.solve(Eigen::VectorXd(Eigen::VectorXd::Unit(size, at + a))).segment<3>(at);
      const Eigen::SelfAdjointEigenSolver<Matrix3d> axes(response, Eigen::EigenvaluesOnly);
      compliance = std::max(compliance, axes.eigenvalues().maxCoeff());
    }
    const double stiffness = 0.75 / compliance;
    if (!std::isfinite(stiffness) || !(stiffness > 0.0)) throw std::invalid_argument(unsupported);
    return stiffness;
  }

  const stickslip_setup setup_;
  const ConstTriangles triangles_;
  const double stiffness_;
  Matrix3Xd shown_, from_; /* 3 x nodes, m: the shape that is felt, and that of the last hand-over */
  double progress_ = 0.0;  /* from `from_` (0) to the model (1) */
  std::unique_ptr<Model> model_;
  int32_t mode_ = STICKSLIP_MODE_FREE;
  SurfacePoint anchor_;
  std::atomic<const char *> message_{""}; /* a constant text */
};

/* ---- Reading of the setup ------------------------------------------------------------------------------------- */

Options read_options(const std::string &text) {
  Options options;
  for (size_t start = 0; start < text.size();) {
    const size_t end = std::min(text.find(';', start), text.size());
    const std::string item = text.substr(start, end - start);
    start = end + 1;
    if (item.empty()) continue;
    const size_t equals = item.find('=');
    const std::string key = item.substr(0, equals);
    if (key != "stiffness") throw std::invalid_argument("unknown option `" + key + "`; the options are: stiffness");
    const std::string value = equals == std::string::npos ? "" : item.substr(equals + 1);
    char *rest = nullptr;
    options.stiffness = std::strtod(value.c_str(), &rest);
    if (value.empty() || *rest != '\0' || !std::isfinite(options.stiffness) || !(options.stiffness > 0.0))
      throw std::invalid_argument("option stiffness: `" + value + "` is not a positive number, N/m");
  }
  return options;
}

void check(const stickslip_body &body, const stickslip_setup &setup) {
  if (body.size < sizeof body || setup.size < sizeof setup)
    throw std::invalid_argument("body or setup is of another version of the interface");
  if (body.nodes == 0 || body.nodes > UINT32_MAX || body.triangles == 0 || body.triangles > UINT32_MAX)
    throw std::invalid_argument("the body has no nodes or no surface, or too many");
  const auto in_range = [&](uint32_t node) { return node < body.nodes; };
  if (!std::all_of(body.triangle_nodes, body.triangle_nodes + 3 * body.triangles, in_range) ||
      !std::all_of(body.spring_nodes, body.spring_nodes + 2 * body.springs, in_range))
    throw std::invalid_argument("a triangle or a spring names a node that the body does not have");
  if (!points(body.rest, body.nodes).allFinite()) throw std::invalid_argument("a rest position is not finite");
  if (!(setup.tick_s > 0.0) || !(setup.cycle_s > 0.0)) throw std::invalid_argument("tick or cycle has no length");
  if (setup.law < STICKSLIP_LAW_SLIDING || setup.law > STICKSLIP_LAW_STICK_SLIP)
    throw std::invalid_argument("the law is unknown");
  if (setup.law == STICKSLIP_LAW_STICK_SLIP &&
      !(setup.friction_kinetic >= 0.0 && setup.friction_static >= setup.friction_kinetic))
    throw std::invalid_argument("friction must be 0 or more, and the static coefficient at least the kinetic one");
}

}  // namespace

/* ---- The interface: no exception crosses it -------------------------------------------------------------------- */

uint32_t stickslip_renderer_abi(void) { return STICKSLIP_RENDERER_ABI; }

void *stickslip_renderer_create(const stickslip_body *body, const stickslip_setup *setup) {
  try {
    check(*body, *setup);
    return new Renderer(*body, *setup, read_options(setup->options));
  } catch (const std::exception &error) {
    try {
      refusal = error.what();
    } catch (...) {
      refusal.clear();
    }
  } catch (...) {
    refusal.clear();
  }
  return nullptr;
}

void *stickslip_renderer_build(void *renderer, const stickslip_state *state) {
  auto *self = static_cast<Renderer *>(renderer);
  try {
    auto model = self->build(*state);
    if (model->x.allFinite()) return model.release();
    self->report("a position of the network is not finite");
  } catch (...) {
    self->report("there is not enough memory for a model");
  }
  return nullptr;
}

void *stickslip_renderer_swap(void *renderer, void *model) {
  return static_cast<Renderer *>(renderer)->swap(std::unique_ptr<Model>(static_cast<Model *>(model))).release();
}

int32_t stickslip_renderer_tick(void *renderer, const double[3], const double tip[3], stickslip_output *output) {
  auto *self = static_cast<Renderer *>(renderer);
  const uint64_t size = output->size;
  *output = stickslip_output{};
  output->size = size;
  const int32_t fault = self->tick(ConstVector(tip), *output);
  if (fault) self->report(FAULT_TEXT[fault]);
  return fault;
}

void stickslip_renderer_dispose(void *model) { delete static_cast<Model *>(model); }

void stickslip_renderer_destroy(void *renderer) { delete static_cast<Renderer *>(renderer); }

uint64_t stickslip_renderer_message(void *renderer, char *buffer, uint64_t capacity) {
  const char *text = renderer ? static_cast<Renderer *>(renderer)->message() : refusal.c_str();
  const uint64_t size = std::strlen(text);
  if (buffer) std::memcpy(buffer, text, std::min(size, capacity));
  return size;
}
