// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb {

/// Where a kernel puts what it sums for each point of a run, from the first one on.
template <typename Scalar>
struct PointSums {
  Scalar* coupling =
      nullptr;                ///< w J_state^T J_depth of one frame, one row a point; null: unwanted
  std::size_t stride = 0;     ///< from row to row
  Scalar* hessian = nullptr;  ///< added to: w J_depth^2
  Scalar* gradient = nullptr;  ///< added to: w J_depth r
};

/// Normal equations over the states of frames, x, and inverse depths of points, d:
///   [H C; C^T diag(h)] [x; d] = -[b; b_d],  H = sum w J^T J, b = sum w J^T r, and so on.
/// @tparam Scalar of the numbers by point
template <typename Scalar>
struct LinearSystem {
  Eigen::MatrixXd H;                   ///< of the states
  Eigen::VectorXd b;                   ///< gradient of half the squared error
  std::size_t stride = 0;              ///< of `coupling`: size() rounded up to 8
  std::vector<Scalar> coupling;        ///< C, one row a point, zeros up to `stride`
  std::vector<Scalar> depth_hessian;   ///< h; 0: the point has no part
  std::vector<Scalar> depth_gradient;  ///< b_d

  LinearSystem() = default;
  /// The same in another precision.
  template <typename Other>
  explicit LinearSystem(const LinearSystem<Other>& other)
      : H(other.H),
        b(other.b),
        stride(other.stride),
        coupling(other.coupling.begin(), other.coupling.end()),
        depth_hessian(other.depth_hessian.begin(), other.depth_hessian.end()),
        depth_gradient(other.depth_gradient.begin(), other.depth_gradient.end()) {}

  /// Sets all to zero but the couplings, which stay as they are while the sizes do.
  void reset(Eigen::Index size, std::size_t points);
  [[nodiscard]] Eigen::Index size() const { return H.rows(); }
  [[nodiscard]] std::size_t points() const { return depth_hessian.size(); }
  [[nodiscard]] bool known(std::size_t point) const { return depth_hessian[point] > 0; }
  /// Couplings of one point with all states.
  [[nodiscard]] Eigen::Map<const Eigen::Matrix<Scalar, Eigen::Dynamic, 1>> couplingOf(
      std::size_t point) const {
    return {coupling.data() + point * stride, H.rows()};
  }
  /// C^T, one row a point.
  [[nodiscard]] auto couplings() const {
    using Rows = Eigen::Matrix<Scalar, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
    return Eigen::Map<const Rows>(coupling.data(),
                                  static_cast<Eigen::Index>(points()),
                                  static_cast<Eigen::Index>(stride))
        .leftCols(H.rows());
  }
  [[nodiscard]] PointSums<Scalar> sumsOf(std::size_t first_point, std::size_t first_state) {
    return {coupling.data() + first_point * stride + first_state,
            stride,
            depth_hessian.data() + first_point,
            depth_gradient.data() + first_point};
  }
};

/// Takes the inverse depths out of a system and puts them back. Sums run over blocks of points
/// whose order is fixed, in parallel inside the caller's arena: the same bits for any number of
/// threads, and in double precision: what the inverse depths leave of gauge directions is a small
/// difference. Keeps its memory for the next time.
/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, section 6.1 (Schur complement)
template <typename Scalar>
class DepthElimination {
 public:
  static constexpr std::size_t kBlock = 128;  ///< points

  /// Sets 1 / ((1 + damping) h), 0 for points without part, which the next two use.
  void damp(const LinearSystem<Scalar>& system, double damping);
  /// Subtracts C D^-1 C^T from H, of which the lower triangle is written, and C D^-1 b_d from b; D
  /// is damped.
  void eliminate(const LinearSystem<Scalar>& system, Eigen::MatrixXd& H, Eigen::VectorXd& b);
  /// Steps of the inverse depths that belong to one of the states: -D^-1 (b_d + C^T step).
  void substituteBack(const LinearSystem<Scalar>& system,
                      const Eigen::VectorXd& step,
                      std::vector<double>& depth_step) const;

 private:
  std::vector<double> inverse_;  // of the damped depth Hessian, by point
  std::vector<double> partial_;  // by block: matrix, then vector
};

/// Solves a system whose diagonal is scaled by 1 + damping.
class DampedSolver {
 public:
  /// @return decrease of the cost, half the squared error, that the equations predict; nullopt when
  ///         they are degenerate
  std::optional<double> solve(const LinearSystem<double>& system, double damping);

  [[nodiscard]] const Eigen::VectorXd& step() const { return step_; }
  [[nodiscard]] const std::vector<double>& depthStep() const { return depth_step_; }

 private:
  DepthElimination<double> elimination_;
  Eigen::MatrixXd reduced_;
  Eigen::VectorXd right_;
  Eigen::VectorXd step_;
  std::vector<double> depth_step_;
};

}  // namespace dsorb
