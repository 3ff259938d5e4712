// SPDX-License-Identifier: Apache-2.0
// Eigen's decompositions of dense matrices of any size. Tests and benches call them through this
// header, because each decomposition takes seconds to compile in every unit that instantiates it.
// All functions allocate. Precondition of all: the entries are finite.
#pragma once

#include <Eigen/Core>

namespace trocar::reference {

/// A singular value decomposition, A = U diag(singular_values) V^T with square U and V.
struct Svd {
  Eigen::MatrixXd U, V;
  Eigen::VectorXd singular_values;  ///< min(rows, columns) values in descending order
};
/// Computes the decomposition by Jacobi's method.
Svd svd(const Eigen::MatrixXd& A);
/// The singular values alone, in descending order.
Eigen::VectorXd singular_values(const Eigen::MatrixXd& A);

/// The shortest of the vectors x for which |A x - b| is least, by the decomposition of svd().
Eigen::VectorXd shortest_solution(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
/// The vector x for which |A x - b| is least, by Householder's method. Precondition: the columns of
/// A are linearly independent.
Eigen::VectorXd least_squares(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
/// The solution of A x = b for a square, regular A, by elimination with full pivoting.
Eigen::VectorXd solve(const Eigen::MatrixXd& A, const Eigen::VectorXd& b);
/// The inverse of a square, regular matrix, by elimination with full pivoting.
Eigen::MatrixXd inverse(const Eigen::MatrixXd& A);
/// An orthogonal matrix: the factor Q of A = Q R. A is square.
Eigen::MatrixXd orthogonal_factor(const Eigen::MatrixXd& A);

/// The eigenvalues of a symmetric matrix in ascending order.
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& A);
/// The values lambda of A x = lambda B x in ascending order, for a symmetric A and a positive
/// definite B.
Eigen::VectorXd eigenvalues(const Eigen::MatrixXd& A, const Eigen::MatrixXd& B);

}  // namespace trocar::reference
